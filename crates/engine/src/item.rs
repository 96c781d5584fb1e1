//! Work items: what is done whole or not at all.

use std::{fmt, ops::Range, str::FromStr};

/// Strands in one block; also the strands of a chunk in the store, so that blocks never share a chunk.
pub const BLOCK_STRANDS: usize = 512;

/// One unit of work within a phase of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Item {
    /// The whole take.
    Take,
    /// One frame.
    Frame(usize),
    /// One view of one frame.
    ViewFrame(usize, usize),
    /// One block of [`BLOCK_STRANDS`] strands, all frames.
    Block(usize),
}

/// The kind of a phase's work items.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// One item.
    Take,
    /// One a frame, independent.
    Frame,
    /// One a frame; each needs the frame before it.
    FrameChained,
    /// One a view and frame, independent.
    ViewFrame,
    /// One a view and frame; each needs a neighbouring frame in the same view.
    ViewFrameChained,
    /// One a block of strands.
    Block,
}

/// Parts of a phase ([`Kind::parts`]) by number: `A..B`, or `NxK` for run number N of K each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ItemRange(pub Range<usize>);

impl Kind {
    /// What tasks share out among them, and `--items` counts: chains, each whole, for there are many; where all items are one
    /// chain, its items. A task that begins within it does what is missing before.
    pub fn parts<T>(self, chains: &[Vec<T>]) -> Vec<&[T]> {
        match self {
            Self::FrameChained => chains.iter().flat_map(|chain| chain.chunks(1)).collect(),
            _ => chains.iter().map(Vec::as_slice).collect(),
        }
    }

    /// The chains of a task that is asked for some parts; what lies beyond the last is none.
    pub(crate) fn chains_of<T: Clone>(self, chains: &[Vec<T>], asked: &Range<usize>) -> Vec<Vec<T>> {
        let within = |count: usize| asked.start.min(count)..asked.end.min(count);
        match self {
            Self::FrameChained => {
                let begun = chains.iter().filter(|chain| asked.start < chain.len());
                begun.map(|chain| chain[..within(chain.len()).end].to_vec()).collect()
            }
            _ => chains[within(chains.len())].to_vec(),
        }
    }
}

impl FromStr for ItemRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let pair = |by: &str| {
            let (a, b) = text.split_once(by)?;
            Some((a.parse::<usize>().ok()?, b.parse::<usize>().ok()?))
        };
        let run =
            |(number, each): (usize, usize)| Some(number.checked_mul(each)?..number.checked_add(1)?.checked_mul(each)?);
        let range = pair("..").map(|(a, b)| a..b).or_else(|| pair("x").and_then(run));
        let range = range.filter(|range| !range.is_empty());
        range.map(Self).ok_or_else(|| {
            format!(
                "`{text}` names no items; write A..B (A first, B one past the last) or NxK (run number N of K each)"
            )
        })
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Take => "take",
            Self::Frame => "frame",
            Self::FrameChained => "frame, in order",
            Self::ViewFrame => "view × frame",
            Self::ViewFrameChained => "view × frame, in order",
            Self::Block => "strand block",
        })
    }
}

impl Item {
    /// The item's key: the path of its record below `.items`.
    pub fn key(self, phase: &str) -> String {
        match self {
            Self::Take => format!("{phase}/take"),
            Self::Frame(frame) => format!("{phase}/{frame:06}"),
            Self::ViewFrame(view, frame) => format!("{phase}/view{view:02}/{frame:06}"),
            Self::Block(block) => format!("{phase}/block{block:04}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_are_done_whole_and_one_chain_from_its_start() {
        let (many, one) = ([vec![1, 2], vec![3, 4], vec![5]], [vec![1, 2, 3, 4, 5]]);
        assert_eq!(Kind::ViewFrameChained.parts(&many).len(), 3);
        assert_eq!(Kind::ViewFrameChained.chains_of(&many, &(1..7)), [vec![3, 4], vec![5]]);
        assert_eq!(Kind::FrameChained.parts(&one).len(), 5);
        assert_eq!(Kind::FrameChained.chains_of(&one, &(2..4)), [vec![1, 2, 3, 4]]);
        assert!(Kind::FrameChained.chains_of(&one, &(5..7)).is_empty());
    }

    #[test]
    fn items_are_read_by_range_or_by_run() {
        let read = |text: &str| text.parse::<ItemRange>().ok().map(|items| items.0);
        assert_eq!(["4..9", "0x12", "3x12"].map(read), [Some(4..9), Some(0..12), Some(36..48)]);
        assert_eq!(
            ["9..4", "3x0", "x", "1x99999999999999999999", "18446744073709551615x2"].map(read),
            [const { None }; 5]
        );
    }
}
