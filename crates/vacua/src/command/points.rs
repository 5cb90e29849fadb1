//! Points in and values out, as CSV.
//!
//! In: columns `x`, `y`, `z` by name, in any order and among others; or three columns without a
//! header. Out: `x,y,z,inside,value`, one line a point in order, numbers printed so that they read
//! back the same; at a level of detail `bound` after that.

use std::io::{Read, Write};

use csv::{ReaderBuilder, StringRecord, Trim};
use glam::DVec3;
use vacua_pack::Estimate;

/// Why points could not be read.
#[derive(Debug, thiserror::Error)]
pub enum PointsError {
    /// The file is no CSV.
    #[error(transparent)]
    Csv(#[from] csv::Error),
    /// The header lacks a column.
    #[error("line 1: expected columns x, y and z, or three numbers; found `{found}`")]
    Header {
        /// The header.
        found: String,
    },
    /// A coordinate that is no number.
    #[error("line {line}: expected a number for {axis}, found `{found}`")]
    Number {
        /// Line of the file, from 1.
        line: u64,
        /// `x`, `y` or `z`.
        axis: &'static str,
        /// What is there.
        found: String,
    },
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// Reads points, a piece at a time.
pub struct PointReader<R> {
    records: csv::StringRecordsIntoIter<R>,
    columns: [usize; 3],
    /// The first line, where it is a point and no header.
    pending: Option<StringRecord>,
}

impl<R: Read> PointReader<R> {
    /// Reads the header, if there is one.
    pub fn new(input: R) -> Result<Self, PointsError> {
        let mut records = ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(Trim::All)
            .comment(Some(b'#'))
            .from_reader(input)
            .into_records();
        let first = match records.next() {
            Some(first) => first?,
            None => StringRecord::new(),
        };
        let is_point = first.len() == 3 && first.iter().all(|cell| cell.parse::<f64>().is_ok());
        let column = |axis: &str| {
            first
                .iter()
                .position(|name| name.eq_ignore_ascii_case(axis))
        };
        let (columns, pending) = if is_point {
            ([0, 1, 2], Some(first))
        } else if let [Some(x), Some(y), Some(z)] = AXES.map(column) {
            ([x, y, z], None)
        } else {
            return Err(PointsError::Header {
                found: first.iter().collect::<Vec<_>>().join(","),
            });
        };
        Ok(Self {
            records,
            columns,
            pending,
        })
    }

    /// The next points, at most `limit` of them; empty at the end.
    pub fn read(&mut self, limit: usize) -> Result<Vec<DVec3>, PointsError> {
        let mut points = Vec::new();
        while points.len() < limit {
            let record = match self.pending.take() {
                Some(record) => record,
                None => match self.records.next() {
                    Some(record) => record?,
                    None => break,
                },
            };
            points.push(self.point(&record)?);
        }
        Ok(points)
    }

    fn point(&self, record: &StringRecord) -> Result<DVec3, PointsError> {
        let mut point = [0.0; 3];
        for ((slot, column), axis) in point.iter_mut().zip(self.columns).zip(AXES) {
            let cell = record.get(column).unwrap_or_default();
            *slot = cell.parse().map_err(|_| PointsError::Number {
                line: record.position().map_or(0, csv::Position::line),
                axis,
                found: cell.to_owned(),
            })?;
        }
        Ok(DVec3::from(point))
    }
}

/// What the result says of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Columns {
    /// Its value.
    Values,
    /// Its value, and how far the exact one may be.
    Bounds,
}

/// Writes the header of the result.
pub fn write_header(out: &mut impl Write, columns: Columns) -> std::io::Result<()> {
    match columns {
        Columns::Values => writeln!(out, "x,y,z,inside,value"),
        Columns::Bounds => writeln!(out, "x,y,z,inside,value,bound"),
    }
}

fn write_point(out: &mut impl Write, point: DVec3) -> std::io::Result<()> {
    for c in point.to_array() {
        write_number(out, c)?;
        out.write_all(b",")?;
    }
    Ok(())
}

/// Writes one line of the result with a bound; `None` is outside.
pub fn write_estimate(
    out: &mut impl Write,
    point: DVec3,
    estimate: Option<Estimate>,
) -> std::io::Result<()> {
    write_point(out, point)?;
    match estimate {
        Some(estimate) => {
            out.write_all(b"1,")?;
            write_number(out, estimate.value)?;
            out.write_all(b",")?;
            write_number(out, estimate.bound)?;
            out.write_all(b"\n")
        }
        None => out.write_all(b"0,,\n"),
    }
}

/// Writes one line of the result; `None` is outside.
pub fn write_value(out: &mut impl Write, point: DVec3, value: Option<f64>) -> std::io::Result<()> {
    write_point(out, point)?;
    match value {
        Some(value) => {
            out.write_all(b"1,")?;
            write_number(out, value)?;
            out.write_all(b"\n")
        }
        None => out.write_all(b"0,\n"),
    }
}

/// The shortest text that reads back as the same number.
fn write_number(out: &mut impl Write, value: f64) -> std::io::Result<()> {
    /// Numbers beyond these powers of ten are written with an exponent.
    const PLAIN: std::ops::Range<f64> = 1e-5..1e16;
    if value == 0.0 || PLAIN.contains(&value.abs()) || !value.is_finite() {
        write!(out, "{value}")
    } else {
        write!(out, "{value:e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &str) -> Result<Vec<DVec3>, PointsError> {
        PointReader::new(text.as_bytes())?.read(usize::MAX)
    }

    #[test]
    fn columns_by_name_or_place() {
        let expected = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.5, -6e3)];
        for text in [
            "x,y,z\n1,2,3\n4,5.5,-6e3\n",
            "1,2,3\n4,5.5,-6e3",
            "id, Z ,y,x\n7,3,2,1\n8, -6000 ,5.5,4\n",
            "# points\nx,y,z\n\n1,2,3\n4,5.5,-6e3\n",
        ] {
            assert_eq!(read(text).expect("points"), expected, "{text}");
        }
        assert_eq!(read("x,y,z\n").expect("none"), []);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let message = |text: &str| read(text).unwrap_err().to_string();
        assert!(message("").contains("columns x, y and z"));
        assert!(message("a,b,c\n1,2,3").contains("`a,b,c`"));
        let text = message("x,y,z\n1,2,3\n1,two,3\n");
        assert!(text.contains("line 3") && text.contains("`two`"), "{text}");
        assert!(message("x,y,z\n1,2\n").contains("line 2"));
    }

    proptest! {
        #[test]
        fn numbers_read_back(value in any::<f64>()) {
            let mut out = Vec::new();
            write_value(&mut out, DVec3::splat(value), Some(value)).expect("memory");
            let text = String::from_utf8(out).expect("text");
            for cell in text.trim_end().split(',').enumerate().filter(|(i, _)| *i != 3).map(|(_, c)| c) {
                let back: f64 = cell.parse().expect("a number");
                prop_assert!(back.to_bits() == value.to_bits() || back.is_nan() && value.is_nan());
            }
        }
    }
}
