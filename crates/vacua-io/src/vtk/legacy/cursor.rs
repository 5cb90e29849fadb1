//! A place in a legacy file, and how it moves over words, lines and bytes.

use std::str::FromStr;

use crate::error::Problem;
use crate::source::Source;

/// Longest text shown in a message.
const SHOWN_CHARS: usize = 40;

/// A piece of a file for a message.
pub(super) fn shown(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes)
        .chars()
        .take(SHOWN_CHARS)
        .collect()
}

/// A place in a legacy file.
pub(super) struct Cursor<'a> {
    source: &'a Source,
    byte: usize,
    is_binary: bool,
    /// Names of arrays of the whole data set that were moved over.
    pub skipped: Vec<String>,
}

impl<'a> Cursor<'a> {
    /// The start of a file.
    pub fn new(source: &'a Source) -> Self {
        Self {
            source,
            byte: 0,
            is_binary: false,
            skipped: Vec::new(),
        }
    }

    /// The file.
    pub fn source(&self) -> &'a Source {
        self.source
    }

    /// The next byte.
    pub fn byte(&self) -> usize {
        self.byte
    }

    /// Whether arrays are stored as big-endian bytes.
    pub fn is_binary(&self) -> bool {
        self.is_binary
    }

    /// Sets whether arrays are stored as big-endian bytes.
    pub fn set_binary(&mut self, is_binary: bool) {
        self.is_binary = is_binary;
    }

    /// Where this is, for messages.
    pub fn place(&self) -> String {
        format!("byte {}", self.byte)
    }

    fn rest(&self) -> &'a [u8] {
        &self.source.bytes()[self.byte..]
    }

    /// Whether nothing but white space is left.
    pub fn is_at_end(&self) -> bool {
        self.peek().is_empty()
    }

    /// The rest of the line, without its end; moves to the next line.
    pub fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let len = memchr::memchr(b'\n', rest);
        self.byte += len.map_or(rest.len(), |len| len + 1);
        let line = &rest[..len.unwrap_or(rest.len())];
        line.strip_suffix(b"\r").unwrap_or(line)
    }

    /// The next word, without moving; empty at the end of the file.
    pub fn peek(&self) -> &'a [u8] {
        let rest = self.rest().trim_ascii_start();
        let len = rest.iter().position(u8::is_ascii_whitespace);
        &rest[..len.unwrap_or(rest.len())]
    }

    /// Whether nothing but blanks is left of the line.
    pub fn is_line_over(&self) -> bool {
        let rest = self.rest();
        let next = rest.iter().find(|b| !matches!(b, b' ' | b'\t' | b'\r'));
        matches!(next, None | Some(b'\n'))
    }

    /// The next word; empty at the end of the file.
    pub fn word(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let start = rest.len() - rest.trim_ascii_start().len();
        let word = self.peek();
        self.byte += start + word.len();
        word
    }

    /// The next word in lower case, as keywords are compared.
    pub fn keyword(&mut self) -> String {
        shown(self.word()).to_ascii_lowercase()
    }

    /// The next word as a name: `%20` is a space.
    pub fn name(&mut self) -> String {
        percent_encoding::percent_decode(self.word())
            .decode_utf8_lossy()
            .into_owned()
    }

    /// The next word as a number.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is none.
    pub fn number<T: FromStr>(&mut self, expected: &str) -> Result<T, Problem> {
        let place = self.place();
        let word = self.word();
        std::str::from_utf8(word)
            .ok()
            .and_then(|w| w.parse().ok())
            .ok_or_else(|| Problem::malformed(place, expected, format!("`{}`", shown(word))))
    }

    /// The next words as numbers.
    ///
    /// # Errors
    /// As [`Self::number`].
    pub fn numbers<T: FromStr + Copy + Default, const N: usize>(
        &mut self,
        expected: &str,
    ) -> Result<[T; N], Problem> {
        let mut numbers = [T::default(); N];
        for number in &mut numbers {
            *number = self.number(expected)?;
        }
        Ok(numbers)
    }

    /// Moves over bytes that must be there.
    ///
    /// # Errors
    /// [`Problem::Truncated`] if they are not.
    pub fn skip_bytes(&mut self, what: &str, len: usize) -> Result<(), Problem> {
        self.source.piece(what, self.byte, len)?;
        self.byte += len;
        Ok(())
    }

    /// Moves over words that must be there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if the file ends before.
    pub fn skip_words(&mut self, what: &str, count: usize) -> Result<(), Problem> {
        let rest = self.rest();
        let mut left = count;
        let mut in_word = false;
        for (i, byte) in rest.iter().enumerate() {
            let is_space = byte.is_ascii_whitespace();
            if in_word && is_space {
                left -= 1;
                in_word = false;
            }
            if left == 0 {
                self.byte += i;
                return Ok(());
            }
            in_word |= !is_space;
        }
        left -= usize::from(in_word);
        self.byte += rest.len();
        if left > 0 {
            return Err(Problem::malformed(
                what,
                format!("{count} numbers"),
                format!("the end of the file after {}", count - left),
            ));
        }
        Ok(())
    }

    /// Moves over a METADATA block, whose keyword has been read: up to an empty line.
    pub fn skip_metadata(&mut self) {
        self.line();
        while !self.rest().is_empty() && !self.line().trim_ascii().is_empty() {}
    }
}
