//! Which strands of a frame a request asks for, and how many points of each.

use crate::Refusal;

/// Most points of one answer: 8,000 strands of 2,000 points. More would only fill the browser's memory.
pub const MOST_POINTS: usize = 16_000_000;

/// Strands `first`, `first + stride`, ... of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Selection {
    /// The first strand.
    pub first: usize,
    /// How many; to the last one by default.
    pub count: Option<usize>,
    /// From each to the next; at least 1.
    pub stride: usize,
    /// So many points a strand, evenly along it (2 to 1024); the store's own by default.
    pub points: Option<usize>,
}

impl Default for Selection {
    fn default() -> Self {
        Self { first: 0, count: None, stride: 1, points: None }
    }
}

impl Selection {
    /// The numbers of the strands, of `strands` that there are.
    ///
    /// # Errors
    /// A strand past the last is asked for.
    pub fn numbers(&self, strands: usize) -> Result<Vec<usize>, Refusal> {
        let all = strands.saturating_sub(self.first).div_ceil(self.stride);
        let count = self.count.unwrap_or(all);
        if count > all {
            let last = count.saturating_sub(1).saturating_mul(self.stride).saturating_add(self.first);
            return Err(Refusal::bad(
                format!("strand {last} is asked for, there are {strands}"),
                "ask for fewer, or leave `count` away",
            ));
        }
        Ok((0..count).map(|i| self.first + i * self.stride).collect())
    }

    /// Points a strand in the answer, of a frame whose strands have `own` points; `count` strands are asked for.
    ///
    /// # Errors
    /// The answer would be too large.
    pub fn points_of(&self, own: usize, count: usize) -> Result<usize, Refusal> {
        let points = self.points.unwrap_or(own);
        if points.saturating_mul(count) > MOST_POINTS {
            let fact =
                format!("{count} strands of {points} points are asked for, at most {MOST_POINTS} points are given");
            return Err(Refusal::bad(fact, "ask for fewer strands or points"));
        }
        Ok(points)
    }
}

/// The values of a query, each used at most once; what nobody asks for is an error.
pub struct Query<'a>(Vec<(&'a str, &'a str)>);

impl<'a> Query<'a> {
    /// Splits a query.
    pub fn new(query: Option<&'a str>) -> Self {
        let pairs = query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty());
        Self(pairs.map(|pair| pair.split_once('=').unwrap_or((pair, ""))).collect())
    }

    /// A whole number within a range, where it is given.
    ///
    /// # Errors
    /// It is no such number.
    pub fn number(&mut self, name: &str, range: std::ops::RangeInclusive<usize>) -> Result<Option<usize>, Refusal> {
        let Some(at) = self.0.iter().position(|(known, _)| *known == name) else { return Ok(None) };
        let (_, text) = self.0.swap_remove(at);
        let number = text.parse().ok().filter(|n| range.contains(n));
        number.map(Some).ok_or_else(|| {
            let hint = format!("give a whole number from {} to {}", range.start(), range.end());
            Refusal::bad(format!("`{name}={text}` in the query"), hint)
        })
    }

    /// The part that chooses strands.
    ///
    /// # Errors
    /// A value is none.
    pub fn selection(&mut self) -> Result<Selection, Refusal> {
        Ok(Selection {
            first: self.number("first", 0..=usize::MAX / 4)?.unwrap_or(0),
            count: self.number("count", 0..=usize::MAX / 4)?,
            stride: self.number("stride", 1..=usize::MAX / 4)?.unwrap_or(1),
            points: self.number("points", 2..=1024)?,
        })
    }

    /// Nothing may be left.
    ///
    /// # Errors
    /// Something is.
    pub fn finish(self) -> Result<(), Refusal> {
        match self.0.first() {
            None => Ok(()),
            Some((name, _)) => {
                Err(Refusal::bad(format!("`{name}` in the query is not known here"), "docs/view.md has the protocol"))
            }
        }
    }
}

/// A number in a path.
///
/// # Errors
/// It is none.
pub fn number_in_path(what: &str, text: &str) -> Result<usize, Refusal> {
    text.parse().map_err(|_| Refusal::bad(format!("`{text}` is no {what}"), format!("give the number of a {what}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(query: &str) -> Result<Selection, Refusal> {
        let mut query = Query::new(Some(query));
        let selection = query.selection()?;
        query.finish().map(|()| selection)
    }

    #[test]
    fn strands_are_counted_from_the_first_by_the_stride() {
        assert_eq!(parsed("").unwrap(), Selection::default());
        let selection = parsed("first=3&count=2&stride=4&points=8").unwrap();
        assert_eq!(selection.numbers(8).unwrap(), [3, 7]);
        assert!(selection.numbers(7).unwrap_err().error.contains("strand 7 is asked for, there are 7"));
        assert_eq!(parsed("first=1&stride=3").unwrap().numbers(8).unwrap(), [1, 4, 7]);
        assert_eq!(parsed("first=9").unwrap().numbers(8).unwrap(), Vec::<usize>::new());
        assert_eq!((selection.points_of(61, 2).unwrap(), Selection::default().points_of(61, 2).unwrap()), (8, 61));
        assert!(selection.points_of(61, usize::MAX).is_err());
    }

    #[test]
    fn what_makes_no_sense_is_told() {
        for (query, word) in [
            ("stride=0", "stride=0"),
            ("points=1", "points=1"),
            ("count=x", "count=x"),
            ("a=1", "`a`"),
            ("first=-1", "-1"),
        ] {
            let refusal = parsed(query).unwrap_err();
            assert!(refusal.error.contains(word) && !refusal.hint.is_empty() && refusal.status() == 400, "{refusal:?}");
        }
        assert!(number_in_path("frame", "x").is_err() && number_in_path("frame", "3") == Ok(3));
    }
}
