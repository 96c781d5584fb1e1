//! Aligned text tables.

use std::fmt;

/// Named rows of cells under a header.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table with these column titles; the first is that of the row names.
    pub fn new(header: &[&str]) -> Self {
        Self { header: header.iter().map(|s| (*s).to_owned()).collect(), rows: Vec::new() }
    }

    /// Adds a row; missing cells stay empty.
    pub fn row(&mut self, name: impl Into<String>, cells: impl IntoIterator<Item = String>) {
        self.rows.push(std::iter::once(name.into()).chain(cells).collect());
    }

    /// Adds a row of numbers with a fixed number of decimals; numbers that are not finite are written as `–`.
    pub fn numbers(&mut self, name: impl Into<String>, decimals: usize, numbers: impl IntoIterator<Item = f64>) {
        let cell = |x: f64| if x.is_finite() { format!("{x:.decimals$}") } else { "–".to_owned() };
        self.row(name, numbers.into_iter().map(cell).collect::<Vec<_>>());
    }

    /// As a Markdown table.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule: Vec<String> =
            self.header.iter().enumerate().map(|(i, _)| if i == 0 { "---" } else { "---:" }.into()).collect();
        let body: String = self.rows.iter().map(|row| line(row)).collect();
        format!("{}{}{body}", line(&self.header), line(&rule))
    }
}

impl fmt::Display for Table {
    /// Names to the left, cells to the right, two blanks between columns.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let all = || std::iter::once(&self.header).chain(&self.rows);
        let columns = all().map(Vec::len).max().unwrap_or(0);
        let width = |i: usize| all().filter_map(|row| row.get(i)).map(|cell| cell.chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..columns).map(width).collect();
        for row in all() {
            let mut line = String::new();
            for (i, cell) in row.iter().enumerate() {
                let pad = " ".repeat(widths[i] - cell.chars().count());
                line += &if i == 0 { format!("{cell}{pad}") } else { format!("  {pad}{cell}") };
            }
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_line_up() {
        let mut table = Table::new(&["metric", "mean", "max"]);
        table.numbers("pose", 2, [0.1, 12.347]);
        table.numbers("length variation", 2, [f64::NAN]);
        assert_eq!(
            table.to_string(),
            "metric            mean    max\npose              0.10  12.35\nlength variation     –\n"
        );
        assert!(table.markdown().starts_with("| metric | mean | max |\n| --- | ---: | ---: |\n"));
    }
}
