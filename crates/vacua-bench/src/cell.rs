//! Cells of a table: a figure, or the reason why there is none.

use std::fmt::Write;

use serde::{Deserialize, Serialize};

/// A figure, or why there is none.
///
/// In JSON a number, or `{"empty": "reason"}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Cell<T> {
    /// What was measured.
    Value(T),
    /// Nothing was.
    Empty {
        /// Why.
        empty: String,
    },
}

impl<T: Copy> Cell<T> {
    /// A cell without a figure.
    pub fn empty(why: impl Into<String>) -> Self {
        Self::Empty { empty: why.into() }
    }

    /// The figure.
    pub fn value(&self) -> Option<T> {
        match self {
            Self::Value(value) => Some(*value),
            Self::Empty { .. } => None,
        }
    }

    /// The same cell in another unit.
    pub fn map<U>(&self, f: impl FnOnce(T) -> U) -> Cell<U> {
        match self {
            Self::Value(value) => Cell::Value(f(*value)),
            Self::Empty { empty } => Cell::Empty {
                empty: empty.clone(),
            },
        }
    }
}

/// The reasons of the empty cells of a table, each said once below it.
#[derive(Debug, Default)]
pub(crate) struct Footnotes {
    reasons: Vec<String>,
}

impl Footnotes {
    /// A cell as text, with the paper's figure in brackets behind it.
    pub fn cell<T: Copy>(
        &mut self,
        cell: &Cell<T>,
        paper: Option<T>,
        format: impl Fn(T) -> String,
    ) -> String {
        let ours = match cell {
            Cell::Value(value) => format(*value),
            Cell::Empty { empty } => format!("– {}", self.mark(empty)),
        };
        match paper {
            Some(paper) => format!("{ours} ({})", format(paper)),
            None => ours,
        }
    }

    /// The mark of a reason.
    fn mark(&mut self, reason: &str) -> String {
        let known = self.reasons.iter().position(|r| r == reason);
        let index = known.unwrap_or_else(|| {
            self.reasons.push(reason.to_owned());
            self.reasons.len() - 1
        });
        format!("[{}]", index + 1)
    }

    /// The reasons, to be put below the table.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (i, reason) in self.reasons.iter().enumerate() {
            // Writing to a string cannot fail.
            let _ = write!(text, "\n[{}] {reason}.", i + 1);
        }
        if !text.is_empty() {
            text.push('\n');
        }
        text
    }
}

/// One line of a table.
pub(crate) fn line<S: AsRef<str>>(cells: impl IntoIterator<Item = S>) -> String {
    let mut text = String::from("|");
    for cell in cells {
        text.push(' ');
        text.push_str(cell.as_ref());
        text.push_str(" |");
    }
    text.push('\n');
    text
}

/// The head of a table with its rule: the first `left` columns hold words, the others figures.
pub(crate) fn head<S: AsRef<str>>(names: &[S], left: usize) -> String {
    let rule = (0..names.len()).map(|i| if i < left { "---" } else { "---:" });
    line(names) + &line(rule)
}

/// Three digits and a unit of time.
pub(crate) fn seconds(secs: f64) -> String {
    if secs < 1e-3 {
        format!("{} µs", digits(secs * 1e6))
    } else if secs < 1.0 {
        format!("{} ms", digits(secs * 1e3))
    } else {
        format!("{} s", digits(secs))
    }
}

/// Three digits and K, M or G.
pub(crate) fn count(count: u64) -> String {
    match count {
        0..1_000 => count.to_string(),
        1_000..1_000_000 => format!("{} K", digits(count as f64 / 1e3)),
        1_000_000..1_000_000_000 => format!("{} M", digits(count as f64 / 1e6)),
        _ => format!("{} G", digits(count as f64 / 1e9)),
    }
}

/// Three digits.
pub(crate) fn digits(value: f64) -> String {
    let decimals = match value.abs() {
        v if v >= 99.95 => 0,
        v if v >= 9.995 => 1,
        _ => 2,
    };
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits() {
        assert_eq!(seconds(42e-6), "42.0 µs");
        assert_eq!(seconds(0.0123), "12.3 ms");
        assert_eq!(seconds(1.5), "1.50 s");
        assert_eq!(count(856), "856");
        assert_eq!(count(1_970_000), "1.97 M");
        assert_eq!(count(15_700_000_000), "15.7 G");
    }

    #[test]
    fn an_empty_cell_says_why_once() {
        let mut notes = Footnotes::default();
        let empty = Cell::<u64>::empty("left out");
        assert_eq!(notes.cell(&empty, Some(7), count), "– [1] (7)");
        assert_eq!(notes.cell(&empty, None, count), "– [1]");
        assert_eq!(notes.cell(&Cell::Value(3), Some(7), count), "3 (7)");
        assert_eq!(notes.text(), "\n[1] left out.\n");
    }

    #[test]
    fn cells_survive_json() {
        for cell in [Cell::Value(0.1), Cell::empty("no memory")] {
            let text = serde_json::to_string(&cell).expect("plain data");
            let read: Cell<f64> = serde_json::from_str(&text).expect("what was written");
            assert_eq!(read, cell);
        }
    }
}
