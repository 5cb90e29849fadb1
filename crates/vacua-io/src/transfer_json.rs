//! Transfer functions as JSON: vacua's own files, and the colour maps that ParaView exports.
//!
//! An own file is one object. It reads back exactly as it was written:
//!
//! ```json
//! {
//!   "vacua_transfer_function": 1,
//!   "scale": "linear",
//!   "unit_length": 0.64,
//!   "colors": [[0.0, 0.23, 0.30, 0.75], [255.0, 0.71, 0.02, 0.15]],
//!   "opacities": [[0.0, 0.0], [255.0, 0.2]]
//! }
//! ```
//!
//! `colors` lists value, red, green, blue (sRGB-encoded, 0 to 1), `opacities` value and opacity per
//! `unit_length` (a world length; it may be left out and then follows from the data), both in order
//! of value; `scale` is `linear` or `log`. Anything else in the object is an error.
//!
//! A ParaView file is a list of colour maps, of which the first counts. Its colours are interpolated
//! in the space it names and its opacity curves (midpoint, sharpness) followed as the Visualization
//! Toolkit does; both are sampled closely enough that straight lines between the points deviate by
//! less than [`CURVE_TOLERANCE`].

mod paraview;
#[cfg(test)]
mod tests;

use std::path::Path;

use serde_json::{Map, Value, json};
use vacua_volume::{ColorPoint, OpacityPoint, TransferFunction, ValueScale};

use crate::error::{IoError, Problem};
use crate::source::Source;
use crate::write_atomically;

pub use paraview::CURVE_TOLERANCE;

/// The key that marks an own file; its value is the version.
const MARK: &str = "vacua_transfer_function";
/// The version that is written, and the only one that is read.
const VERSION: u64 = 1;
/// Files longer than this are no transfer functions.
const MAX_FILE_BYTES: usize = 16 << 20;

/// A transfer function from a file, and what the user should know about how it was understood.
#[derive(Clone, Debug, PartialEq)]
pub struct TransferFile {
    /// The transfer function.
    pub function: TransferFunction,
    /// What was ignored or assumed.
    pub notes: Vec<String>,
}

/// Reads a transfer function. `default_unit_length` (world length) is the reference length of
/// opacity if the file has none, as ParaView's files do.
///
/// # Errors
/// [`IoError`] naming the file, the place in it, and what was expected there.
pub fn read_transfer_function(
    path: &Path,
    default_unit_length: f64,
) -> Result<TransferFile, IoError> {
    let source = Source::open(path)?;
    transfer_function_from_json(source.bytes(), default_unit_length).map_err(|p| p.in_file(path))
}

/// Writes a transfer function as an own file.
///
/// # Errors
/// [`IoError`] if the file cannot be written.
pub fn write_transfer_function(path: &Path, function: &TransferFunction) -> Result<(), IoError> {
    let text = transfer_function_to_json(function);
    write_atomically(path, |file| {
        std::io::Write::write_all(file, text.as_bytes())
    })
}

/// A transfer function as the text of an own file.
pub fn transfer_function_to_json(function: &TransferFunction) -> String {
    let colors: Vec<Value> = function
        .colors()
        .iter()
        .map(|c| json!([c.value, c.srgb[0], c.srgb[1], c.srgb[2]]))
        .collect();
    let opacities: Vec<Value> = function
        .opacities()
        .iter()
        .map(|o| json!([o.value, o.opacity]))
        .collect();
    let scale = match function.scale() {
        ValueScale::Linear => "linear",
        ValueScale::Log => "log",
    };
    let one_a_line = |points: &[Value]| {
        let lines: Vec<String> = points.iter().map(|p| format!("    {p}")).collect();
        format!("[\n{}\n  ]", lines.join(",\n"))
    };
    format!(
        "{{\n  \"{MARK}\": {VERSION},\n  \"scale\": \"{scale}\",\n  \"unit_length\": {},\n  \"colors\": {},\n  \"opacities\": {}\n}}\n",
        json!(function.unit_length()),
        one_a_line(&colors),
        one_a_line(&opacities),
    )
}

/// A transfer function from the text of an own file or one of ParaView's.
///
/// # Errors
/// [`Problem`] naming the place and what was expected there.
pub fn transfer_function_from_json(
    text: &[u8],
    default_unit_length: f64,
) -> Result<TransferFile, Problem> {
    if text.len() > MAX_FILE_BYTES {
        return Err(Problem::malformed(
            "the file's length",
            format!("a transfer function of at most {MAX_FILE_BYTES} bytes"),
            format!("{} bytes", text.len()),
        ));
    }
    let value: Value = serde_json::from_slice(text).map_err(|e| {
        Problem::malformed(
            format!("line {}, column {}", e.line(), e.column()),
            "JSON",
            e.to_string(),
        )
    })?;
    match &value {
        Value::Object(object) if object.contains_key(MARK) => own(object, default_unit_length),
        Value::Object(object) if paraview::is_map(object) => {
            paraview::read(object, "colour map", default_unit_length)
        }
        Value::Array(maps) => {
            let Some(Value::Object(first)) = maps.first() else {
                return Err(Problem::malformed(
                    "the list of colour maps",
                    "an object with `RGBPoints`",
                    maps.first().map_or("an empty list", kind_of),
                ));
            };
            let mut file = paraview::read(first, "colour map 0", default_unit_length)?;
            if maps.len() > 1 {
                file.notes.push(format!(
                    "the file holds {} colour maps; the first is used",
                    maps.len()
                ));
            }
            Ok(file)
        }
        other => Err(Problem::malformed(
            "the file",
            format!("an object with `{MARK}`, or ParaView's list of colour maps with `RGBPoints`"),
            kind_of(other),
        )),
    }
}

/// What a JSON value is, in words.
fn kind_of(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a truth value",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "a list",
        Value::Object(_) => "an object",
    }
}

/// The finite number at a place.
fn number(value: &Value, place: impl FnOnce() -> String) -> Result<f64, Problem> {
    value
        .as_f64()
        .filter(|v| v.is_finite())
        .ok_or_else(|| Problem::malformed(place(), "a finite number", value.to_string()))
}

/// The list at a place.
fn list<'a>(value: &'a Value, place: &str) -> Result<&'a [Value], Problem> {
    value
        .as_array()
        .map(Vec::as_slice)
        .ok_or_else(|| Problem::malformed(place, "a list", kind_of(value)))
}

/// Reads vacua's own object.
fn own(object: &Map<String, Value>, default_unit_length: f64) -> Result<TransferFile, Problem> {
    const KEYS: [&str; 5] = [MARK, "scale", "unit_length", "colors", "opacities"];
    if let Some(key) = object.keys().find(|key| !KEYS.contains(&key.as_str())) {
        return Err(Problem::malformed(
            "the object",
            format!("only the keys {}", KEYS.join(", ")),
            format!("`{key}`"),
        ));
    }
    if object[MARK].as_u64() != Some(VERSION) {
        return Err(Problem::malformed(
            format!("`{MARK}`"),
            format!("version {VERSION}"),
            object[MARK].to_string(),
        ));
    }
    let scale = match object.get("scale") {
        None => ValueScale::Linear,
        Some(value) => match value.as_str() {
            Some("linear") => ValueScale::Linear,
            Some("log") => ValueScale::Log,
            _ => {
                return Err(Problem::malformed(
                    "`scale`",
                    "\"linear\" or \"log\"",
                    value.to_string(),
                ));
            }
        },
    };
    let unit_length = match object.get("unit_length") {
        None | Some(Value::Null) => default_unit_length,
        Some(value) => number(value, || "`unit_length`".to_owned())?,
    };
    let colors = tuples::<4>(object, "colors")?
        .into_iter()
        .map(|[value, r, g, b]| ColorPoint {
            value,
            srgb: [r, g, b],
        })
        .collect();
    let opacities = tuples::<2>(object, "opacities")?
        .into_iter()
        .map(|[value, opacity]| OpacityPoint { value, opacity })
        .collect();
    Ok(TransferFile {
        function: TransferFunction::new(colors, opacities, unit_length, scale)?,
        notes: Vec::new(),
    })
}

/// A list of lists of `N` numbers.
fn tuples<const N: usize>(
    object: &Map<String, Value>,
    key: &str,
) -> Result<Vec<[f64; N]>, Problem> {
    let value = object
        .get(key)
        .ok_or_else(|| Problem::malformed("the object", format!("a list `{key}`"), "none"))?;
    let mut points = Vec::new();
    for (i, point) in list(value, &format!("`{key}`"))?.iter().enumerate() {
        let place = || format!("`{key}`[{i}]");
        let numbers = list(point, &place())?;
        if numbers.len() != N {
            return Err(Problem::malformed(
                place(),
                format!("{N} numbers"),
                format!("{} of them", numbers.len()),
            ));
        }
        let mut tuple = [0.0; N];
        for (slot, n) in tuple.iter_mut().zip(numbers) {
            *slot = number(n, place)?;
        }
        points.push(tuple);
    }
    Ok(points)
}
