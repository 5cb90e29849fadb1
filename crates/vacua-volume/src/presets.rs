//! Colour maps by the names people know.
//!
//! viridis, inferno, magma, plasma, cividis, turbo, spectral and the like come from the crate
//! `colorous`, which holds the published tables; the maps it lacks are given here by their control
//! points and the space these are interpolated in.

use crate::color_space::ColorSpace;
use crate::range::ValueRange;
use crate::transfer::{ColorPoint, ValueScale};

/// Number of points in a sampled colour map: that of the published tables.
pub const PRESET_POINTS: usize = 256;

/// Where a map comes from.
enum Source {
    /// A gradient of `colorous`, possibly reversed so that it runs from low to high.
    Gradient(colorous::Gradient, Direction),
    /// Control points (position in `0..=1`, sRGB) and the space between them.
    Points(&'static [(f64, [f64; 3])], ColorSpace),
}

enum Direction {
    Forward,
    Reversed,
}

/// Moreland's cool to warm, ParaView's default for many years (Moreland 2009, Table 1).
const COOL_WARM: &[(f64, [f64; 3])] = &[(0.0, [0.230, 0.299, 0.754]), (1.0, [0.706, 0.016, 0.150])];
/// Black, red, yellow, white.
const BLACK_BODY: &[(f64, [f64; 3])] = &[
    (0.0, [0.0, 0.0, 0.0]),
    (0.4, [0.901961, 0.0, 0.0]),
    (0.8, [0.901961, 0.901961, 0.0]),
    (1.0, [1.0, 1.0, 1.0]),
];
/// MATLAB's classic, as matplotlib has it.
const JET: &[(f64, [f64; 3])] = &[
    (0.0, [0.0, 0.0, 0.5]),
    (0.125, [0.0, 0.0, 1.0]),
    (0.375, [0.0, 1.0, 1.0]),
    (0.625, [1.0, 1.0, 0.0]),
    (0.875, [1.0, 0.0, 0.0]),
    (1.0, [0.5, 0.0, 0.0]),
];
/// ParaView's "Rainbow Desaturated".
const RAINBOW_DESATURATED: &[(f64, [f64; 3])] = &[
    (0.0, [0.278431, 0.278431, 0.858824]),
    (0.143, [0.0, 0.0, 0.360784]),
    (0.285, [0.0, 1.0, 1.0]),
    (0.429, [0.0, 0.501961, 0.0]),
    (0.571, [1.0, 1.0, 0.0]),
    (0.714, [1.0, 0.380392, 0.0]),
    (0.857, [0.419608, 0.0, 0.0]),
    (1.0, [0.878431, 0.301961, 0.301961]),
];
const GREY: &[(f64, [f64; 3])] = &[(0.0, [0.0; 3]), (1.0, [1.0; 3])];
const WHITE: &[(f64, [f64; 3])] = &[(0.0, [1.0; 3]), (1.0, [1.0; 3])];

/// Every map, under its name.
const PRESETS: &[(&str, Source)] = &[
    (
        "viridis",
        Source::Gradient(colorous::VIRIDIS, Direction::Forward),
    ),
    (
        "inferno",
        Source::Gradient(colorous::INFERNO, Direction::Forward),
    ),
    (
        "magma",
        Source::Gradient(colorous::MAGMA, Direction::Forward),
    ),
    (
        "plasma",
        Source::Gradient(colorous::PLASMA, Direction::Forward),
    ),
    (
        "cividis",
        Source::Gradient(colorous::CIVIDIS, Direction::Forward),
    ),
    (
        "turbo",
        Source::Gradient(colorous::TURBO, Direction::Forward),
    ),
    ("grey", Source::Points(GREY, ColorSpace::Rgb)),
    ("white", Source::Points(WHITE, ColorSpace::Rgb)),
    (
        "cool-warm",
        Source::Points(COOL_WARM, ColorSpace::Diverging),
    ),
    ("black-body", Source::Points(BLACK_BODY, ColorSpace::Rgb)),
    (
        "rainbow-desaturated",
        Source::Points(RAINBOW_DESATURATED, ColorSpace::Rgb),
    ),
    ("jet", Source::Points(JET, ColorSpace::Rgb)),
    (
        "spectral",
        Source::Gradient(colorous::SPECTRAL, Direction::Reversed),
    ),
    (
        "red-blue",
        Source::Gradient(colorous::RED_BLUE, Direction::Reversed),
    ),
    (
        "brown-green",
        Source::Gradient(colorous::BROWN_GREEN, Direction::Forward),
    ),
    (
        "purple-orange",
        Source::Gradient(colorous::PURPLE_ORANGE, Direction::Forward),
    ),
    (
        "blues",
        Source::Gradient(colorous::BLUES, Direction::Forward),
    ),
    (
        "greens",
        Source::Gradient(colorous::GREENS, Direction::Forward),
    ),
    (
        "oranges",
        Source::Gradient(colorous::ORANGES, Direction::Forward),
    ),
    ("reds", Source::Gradient(colorous::REDS, Direction::Forward)),
    (
        "cubehelix",
        Source::Gradient(colorous::CUBEHELIX, Direction::Forward),
    ),
    (
        "sinebow",
        Source::Gradient(colorous::SINEBOW, Direction::Forward),
    ),
];

/// Other spellings of the same maps.
const ALIASES: &[(&str, &str)] = &[
    ("gray", "grey"),
    ("grayscale", "grey"),
    ("greyscale", "grey"),
    ("coolwarm", "cool-warm"),
    ("cool-to-warm", "cool-warm"),
    ("blackbody", "black-body"),
    ("rainbow", "rainbow-desaturated"),
];

/// A name that is no colour map.
#[derive(Clone, Debug, thiserror::Error, PartialEq, Eq)]
#[error("there is no colour map `{name}`; there are: {}", names().collect::<Vec<_>>().join(", "))]
pub struct UnknownPreset {
    /// What was asked for.
    pub name: String,
}

/// The names of all colour maps.
pub fn names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|(name, _)| *name)
}

/// The points of a colour map, spread evenly over `range`, in order of value.
///
/// Case does not matter, `_` and blanks read as `-`.
///
/// # Errors
/// [`UnknownPreset`], which lists the names there are.
pub fn color_points(name: &str, range: ValueRange) -> Result<Vec<ColorPoint>, UnknownPreset> {
    color_points_on(name, range, ValueScale::Linear)
}

/// The points of a colour map, spread over `range` evenly on the given scale. A logarithmic scale
/// takes a range of positive values.
///
/// # Errors
/// [`UnknownPreset`], which lists the names there are.
pub fn color_points_on(
    name: &str,
    range: ValueRange,
    scale: ValueScale,
) -> Result<Vec<ColorPoint>, UnknownPreset> {
    let wanted = name.trim().to_ascii_lowercase().replace(['_', ' '], "-");
    let wanted = ALIASES
        .iter()
        .find(|(alias, _)| *alias == wanted)
        .map_or(wanted.as_str(), |(_, name)| name);
    let (_, source) = PRESETS
        .iter()
        .find(|(known, _)| *known == wanted)
        .ok_or_else(|| UnknownPreset {
            name: name.to_owned(),
        })?;
    let sampled = |color: &dyn Fn(usize) -> [f64; 3]| {
        (0..PRESET_POINTS)
            .map(|i| ColorPoint {
                value: scale.at(range, i as f64 / (PRESET_POINTS - 1) as f64),
                srgb: color(i),
            })
            .collect()
    };
    Ok(match source {
        Source::Gradient(gradient, direction) => sampled(&|i| {
            let i = match direction {
                Direction::Forward => i,
                Direction::Reversed => PRESET_POINTS - 1 - i,
            };
            let color = gradient.eval_rational(i, PRESET_POINTS);
            [color.r, color.g, color.b].map(|c| f64::from(c) / 255.0)
        }),
        Source::Points(points, ColorSpace::Rgb) => points
            .iter()
            .map(|&(position, srgb)| ColorPoint {
                value: scale.at(range, position),
                srgb,
            })
            .collect(),
        Source::Points(points, space) => sampled(&|i| {
            let position = i as f64 / (PRESET_POINTS - 1) as f64;
            let after = points.partition_point(|p| p.0 <= position);
            let b = points[after.min(points.len() - 1)];
            let a = points[after.saturating_sub(1).min(points.len() - 2)];
            space.mix(a.1, b.1, (position - a.0) / (b.0 - a.0))
        }),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: ValueRange = ValueRange { lo: 0.0, hi: 1.0 };

    fn hex(points: &[ColorPoint], i: usize) -> String {
        let byte = |c: f64| (c * 255.0).round() as u8;
        let [r, g, b] = points[i].srgb.map(byte);
        format!("{r:02x}{g:02x}{b:02x}")
    }

    #[test]
    fn every_name_makes_a_transfer_function() {
        use crate::transfer::{OpacityPoint, TransferFunction};
        for name in names().chain(ALIASES.iter().map(|(alias, _)| *alias)) {
            let range = ValueRange { lo: 2.0, hi: 50.0 };
            for scale in [ValueScale::Linear, ValueScale::Log] {
                let colors = color_points_on(name, range, scale).expect("a known name");
                assert_eq!(colors[0].value, 2.0, "{name}");
                assert_eq!(colors[colors.len() - 1].value, 50.0, "{name}");
                let opacity = vec![OpacityPoint {
                    value: 2.0,
                    opacity: 0.5,
                }];
                TransferFunction::new(colors, opacity, 1.0, scale).expect("in order and in range");
            }
        }
    }

    #[test]
    fn published_colors() {
        let viridis = color_points("Viridis", UNIT).expect("known");
        assert_eq!(hex(&viridis, 0), "440154");
        assert_eq!(hex(&viridis, 255), "fde725");
        let inferno = color_points("inferno", UNIT).expect("known");
        assert_eq!(hex(&inferno, 0), "000004");
        assert_eq!(hex(&inferno, 255), "fcffa4");
    }

    #[test]
    fn cool_warm_is_morelands() {
        // The table published with the paper (256 entries): ends, quarter points and the middle.
        let map = color_points("cool_warm", UNIT).expect("known");
        let published = [
            (0, [59, 76, 192]),
            (64, [141, 176, 254]),
            (191, [244, 154, 123]),
            (255, [180, 4, 38]),
        ];
        for (i, expected) in published {
            for c in 0..3 {
                let got = map[i].srgb[c] * 255.0;
                assert!(
                    (got - f64::from(expected[c])).abs() <= 1.5,
                    "{i}: {:?}",
                    map[i].srgb.map(|c| c * 255.0)
                );
            }
        }
        let middle = ColorSpace::Diverging.mix(COOL_WARM[0].1, COOL_WARM[1].1, 0.5);
        for c in middle {
            assert!((c - 0.865).abs() < 0.002, "{middle:?}");
        }
    }

    #[test]
    fn unknown_names_list_the_known_ones() {
        let message = color_points("virdis", UNIT).unwrap_err().to_string();
        assert!(
            message.contains("`virdis`") && message.contains("viridis"),
            "{message}"
        );
    }
}
