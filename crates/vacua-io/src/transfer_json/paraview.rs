//! ParaView's exported colour maps: its curves become straight lines between enough points.
//!
//! Source: the Visualization Toolkit's `vtkColorTransferFunction` and `vtkPiecewiseFunction`, which
//! define what the numbers in these files mean.

use serde_json::{Map, Value};
use vacua_volume::{
    ColorPoint, ColorSpace, DEFAULT_RAMP_OPACITY, OpacityPoint, TransferFunction, ValueRange,
    ValueScale,
};

use super::{TransferFile, kind_of, list, number};
use crate::error::Problem;

/// Largest deviation, in any component, of the straight lines that replace a curve.
pub const CURVE_TOLERANCE: f64 = 1.0 / 1024.0;
/// Times an interval is halved at most while a curve is replaced by straight lines.
const MAX_HALVINGS: u32 = 10;
/// About the largest number of points that following curves may add; a file with more points than
/// this keeps straight lines between them.
const MAX_ADDED_POINTS: usize = 1 << 16;

/// Whether an object looks like a colour map of ParaView.
pub(super) fn is_map(object: &Map<String, Value>) -> bool {
    ["RGBPoints", "ColorSpace", "IndexedColors"]
        .iter()
        .any(|key| object.contains_key(*key))
}

/// Reads one of ParaView's colour maps.
pub(super) fn read(
    object: &Map<String, Value>,
    place: &str,
    default_unit_length: f64,
) -> Result<TransferFile, Problem> {
    const READ: [&str; 7] = [
        "Name",
        "RGBPoints",
        "Points",
        "ColorSpace",
        "UseLogScale",
        "HSVWrap",
        "DefaultMap",
    ];
    if object.contains_key("IndexedColors") && !object.contains_key("RGBPoints") {
        return Err(Problem::Unsupported {
            what: format!("{place}: categorical colours (`IndexedColors`)"),
            hint: Some("export a colour map with `RGBPoints`".to_owned()),
        });
    }
    let mut notes: Vec<String> = object
        .keys()
        .filter(|key| !READ.contains(&key.as_str()))
        .map(|key| format!("`{key}` of the ParaView colour map is ignored"))
        .collect();
    let scale = if truth(object, "UseLogScale", place)? {
        ValueScale::Log
    } else {
        ValueScale::Linear
    };
    let space = color_space(object, place)?;
    let mut controls: Vec<ColorPoint> = flat_tuples::<4>(object, "RGBPoints", place)?
        .into_iter()
        .map(|[value, r, g, b]| ColorPoint {
            value,
            srgb: [r, g, b],
        })
        .collect();
    controls.sort_by(|a, b| a.value.total_cmp(&b.value));
    let (Some(first), Some(last)) = (controls.first(), controls.last()) else {
        return Err(Problem::malformed(
            format!("{place}: `RGBPoints`"),
            "value, red, green, blue for at least one point",
            "nothing",
        ));
    };
    let range = ValueRange {
        lo: first.value,
        hi: last.value,
    };
    let curve = match object.get("Points") {
        None | Some(Value::Null) => Vec::new(),
        Some(_) => flat_tuples::<4>(object, "Points", place)?,
    };
    let opacities = if curve.is_empty() {
        notes.push("the colour map has no opacity points; a ramp from 0 is used".to_owned());
        vec![
            OpacityPoint {
                value: range.lo,
                opacity: 0.0,
            },
            OpacityPoint {
                value: range.hi,
                opacity: DEFAULT_RAMP_OPACITY,
            },
        ]
    } else {
        let mut knots: Vec<OpacityPoint> = curve
            .iter()
            .map(|&[value, opacity, ..]| OpacityPoint { value, opacity })
            .collect();
        knots.sort_by(|a, b| a.value.total_cmp(&b.value));
        // Checked before the curves are followed, so that they are followed on sound numbers only.
        TransferFunction::new(controls.clone(), knots, default_unit_length, scale)?;
        straightened_opacities(curve, scale)
    };
    TransferFunction::new(
        controls.clone(),
        opacities.clone(),
        default_unit_length,
        scale,
    )?;
    let colors = straightened_colors(&controls, space, scale);
    Ok(TransferFile {
        function: TransferFunction::new(colors, opacities, default_unit_length, scale)?,
        notes,
    })
}

fn truth(object: &Map<String, Value>, key: &str, place: &str) -> Result<bool, Problem> {
    match object.get(key) {
        None | Some(Value::Null) => Ok(false),
        Some(Value::Bool(truth)) => Ok(*truth),
        Some(value) => match value.as_i64() {
            Some(0) => Ok(false),
            Some(1) => Ok(true),
            _ => Err(Problem::malformed(
                format!("{place}: `{key}`"),
                "true, false, 0 or 1",
                value.to_string(),
            )),
        },
    }
}

fn color_space(object: &Map<String, Value>, place: &str) -> Result<ColorSpace, Problem> {
    let name = match object.get("ColorSpace") {
        None => return Ok(ColorSpace::Rgb),
        Some(Value::String(name)) => name.as_str(),
        Some(other) => {
            return Err(Problem::malformed(
                format!("{place}: `ColorSpace`"),
                "a text",
                kind_of(other),
            ));
        }
    };
    match name.to_ascii_lowercase().as_str() {
        "rgb" => Ok(ColorSpace::Rgb),
        "hsv" if truth(object, "HSVWrap", place)? => Ok(ColorSpace::HsvWrapped),
        "hsv" => Ok(ColorSpace::Hsv),
        "lab" | "cielab" => Ok(ColorSpace::Lab),
        "diverging" => Ok(ColorSpace::Diverging),
        "step" => Ok(ColorSpace::Step),
        _ => Err(Problem::Unsupported {
            what: format!("{place}: the colour space `{name}`"),
            hint: Some("export the map with RGB, HSV, Lab, Diverging or Step".to_owned()),
        }),
    }
}

/// A flat list of numbers in groups of `N`.
fn flat_tuples<const N: usize>(
    object: &Map<String, Value>,
    key: &str,
    place: &str,
) -> Result<Vec<[f64; N]>, Problem> {
    let place = format!("{place}: `{key}`");
    let value = object
        .get(key)
        .ok_or_else(|| Problem::malformed(place.clone(), "a list of numbers", "none"))?;
    let numbers = list(value, &place)?;
    if numbers.len() % N != 0 {
        return Err(Problem::malformed(
            place,
            format!("numbers in groups of {N}"),
            format!("{} numbers", numbers.len()),
        ));
    }
    let mut tuples = Vec::with_capacity(numbers.len() / N);
    for (i, group) in numbers.chunks_exact(N).enumerate() {
        let mut tuple = [0.0; N];
        for (c, (slot, n)) in tuple.iter_mut().zip(group).enumerate() {
            *slot = number(n, || format!("{place}[{}]", i * N + c))?;
        }
        tuples.push(tuple);
    }
    Ok(tuples)
}

/// Colour points whose straight lines in sRGB follow the curves of a colour space.
fn straightened_colors(
    controls: &[ColorPoint],
    space: ColorSpace,
    scale: ValueScale,
) -> Vec<ColorPoint> {
    if space.is_linear() || controls.len() < 2 {
        return controls.to_vec();
    }
    let halvings = allowed_halvings(controls.len() - 1);
    let mut points = vec![controls[0]];
    for pair in controls.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        if space == ColorSpace::Step {
            points.push(ColorPoint {
                value: a.value,
                srgb: b.srgb,
            });
        } else {
            let range = ValueRange {
                lo: a.value,
                hi: b.value,
            };
            for t in breaks(|t| space.mix(a.srgb, b.srgb, t), halvings) {
                points.push(ColorPoint {
                    value: scale.at(range, t),
                    srgb: space.mix(a.srgb, b.srgb, t).map(|c| c.clamp(0.0, 1.0)),
                });
            }
        }
        points.push(b);
    }
    points
}

/// Opacity points whose straight lines follow ParaView's curves: value, opacity, midpoint and
/// sharpness of the stretch that follows.
fn straightened_opacities(mut controls: Vec<[f64; 4]>, scale: ValueScale) -> Vec<OpacityPoint> {
    controls.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let point = |value, opacity| OpacityPoint { value, opacity };
    let halvings = allowed_halvings(controls.len());
    let mut points = Vec::new();
    for pair in controls.windows(2) {
        let [lo, from, midpoint, sharpness] = pair[0];
        let [hi, to, ..] = pair[1];
        points.push(point(lo, from));
        let range = ValueRange { lo, hi };
        let midpoint = midpoint.clamp(0.00001, 0.99999);
        if sharpness > 0.99 {
            let step = scale.at(range, midpoint);
            points.extend([point(step, from), point(step, to)]);
        } else if sharpness < 0.01 {
            if midpoint != 0.5 {
                points.push(point(scale.at(range, midpoint), 0.5 * (from + to)));
            }
        } else {
            let curve = |t| [hermite(t, from, to, midpoint, sharpness)];
            points.extend(
                breaks(curve, halvings)
                    .into_iter()
                    .map(|t| point(scale.at(range, t), curve(t)[0])),
            );
        }
    }
    points.extend(controls.last().map(|last| point(last[0], last[1])));
    points
}

/// The Visualization Toolkit's opacity between two points (`vtkPiecewiseFunction`): position bent
/// by the midpoint, sharpened by a power, and run through a Hermite curve with flattened ends.
fn hermite(t: f64, from: f64, to: f64, midpoint: f64, sharpness: f64) -> f64 {
    let s = if t < midpoint {
        0.5 * t / midpoint
    } else {
        0.5 + 0.5 * (t - midpoint) / (1.0 - midpoint)
    };
    let power = 1.0 + 10.0 * sharpness;
    let s = if s < 0.5 {
        0.5 * (2.0 * s).powf(power)
    } else {
        1.0 - 0.5 * (2.0 * (1.0 - s)).powf(power)
    };
    let (s2, s3) = (s * s, s * s * s);
    let slope = (1.0 - sharpness) * (to - from);
    let value = (2.0 * s3 - 3.0 * s2 + 1.0) * from
        + (3.0 * s2 - 2.0 * s3) * to
        + (s3 - 2.0 * s2 + s) * slope
        + (s3 - s2) * slope;
    value.max(from.min(to)).min(from.max(to))
}

/// The places strictly between 0 and 1 at which a curve is cut so that straight lines between them
/// stay within [`CURVE_TOLERANCE`] of it, as far as so many halvings reach.
fn breaks<const N: usize>(curve: impl Fn(f64) -> [f64; N], halvings: u32) -> Vec<f64> {
    /// Equal parts at whose ends a stretch is compared with its straight line.
    const PROBES: u32 = 8;
    fn halve<const N: usize>(
        curve: &impl Fn(f64) -> [f64; N],
        (a, b): (f64, f64),
        halvings: u32,
        out: &mut Vec<f64>,
    ) {
        let (from, to) = (curve(a), curve(b));
        let close = (1..PROBES).all(|i| {
            let f = f64::from(i) / f64::from(PROBES);
            let at = curve(a + f * (b - a));
            (0..N).all(|c| (from[c] + f * (to[c] - from[c]) - at[c]).abs() <= CURVE_TOLERANCE)
        });
        if close || halvings == 0 {
            return;
        }
        let middle = 0.5 * (a + b);
        halve(curve, (a, middle), halvings - 1, out);
        out.push(middle);
        halve(curve, (middle, b), halvings - 1, out);
    }
    let mut out = Vec::new();
    halve(&curve, (0.0, 1.0), halvings, &mut out);
    out
}

/// How often each of `intervals` intervals may be halved within [`MAX_ADDED_POINTS`].
fn allowed_halvings(intervals: usize) -> u32 {
    (MAX_ADDED_POINTS / intervals.max(1))
        .checked_ilog2()
        .unwrap_or(0)
        .min(MAX_HALVINGS)
}
