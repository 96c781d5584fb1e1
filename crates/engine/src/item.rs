//! Work items: what is done whole or not at all.

use std::fmt;

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
