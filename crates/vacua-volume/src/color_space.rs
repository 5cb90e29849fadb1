//! Interpolation of colours in the spaces that published colour maps are defined in.
//!
//! The formulas are those of the Visualization Toolkit, so that a colour map exported from ParaView
//! looks here as it looks there: CIELAB with the white point D65, and Moreland's Msh, a polar form
//! of CIELAB (K. Moreland, "Diverging Color Maps for Scientific Visualization", ISVC 2009, §4:
//! M magnitude, s saturation angle, h hue angle).

use std::f64::consts::{PI, TAU};

use crate::transfer::linear_from_srgb;

/// The space in which colours between two given ones are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorSpace {
    /// Straight lines in sRGB-encoded components.
    Rgb,
    /// Hue, saturation and value, hue never passing from 1 to 0.
    Hsv,
    /// Hue, saturation and value, hue along the shorter way around the circle.
    HsvWrapped,
    /// Straight lines in CIELAB.
    Lab,
    /// Straight lines in Moreland's Msh, through white where the ends are saturated and differ in hue.
    Diverging,
    /// No interpolation: an interval has the colour of its upper end.
    Step,
}

/// White point D65 as the Visualization Toolkit writes it.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];
/// Below this saturation angle a colour counts as grey (Moreland, Figure 7).
const UNSATURATED: f64 = 0.05;
/// Least magnitude of the white in the middle of a diverging map (Moreland, §5).
const WHITE_MAGNITUDE: f64 = 88.0;

impl ColorSpace {
    /// The colour a fraction `t` (`0..=1`) of the way from `a` to `b`, all sRGB-encoded in `0..=1`.
    pub fn mix(self, a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
        match self {
            Self::Rgb => lerp(a, b, t),
            Self::Hsv => srgb_from_hsv(lerp(hsv_from_srgb(a), hsv_from_srgb(b), t)),
            Self::HsvWrapped => {
                let (mut a, mut b) = (hsv_from_srgb(a), hsv_from_srgb(b));
                if a[0] - b[0] > 0.5 {
                    b[0] += 1.0;
                } else if b[0] - a[0] > 0.5 {
                    a[0] += 1.0;
                }
                srgb_from_hsv(lerp(a, b, t))
            }
            Self::Lab => srgb_from_lab(lerp(lab_from_srgb(a), lab_from_srgb(b), t)),
            Self::Diverging => diverging(a, b, t),
            Self::Step => {
                if t > 0.0 {
                    b
                } else {
                    a
                }
            }
        }
    }

    /// Whether a straight line in sRGB between neighbouring points is the whole story.
    pub fn is_linear(self) -> bool {
        self == Self::Rgb
    }
}

fn lerp(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    [0, 1, 2].map(|c| a[c] + t * (b[c] - a[c]))
}

fn hsv_from_srgb([r, g, b]: [f64; 3]) -> [f64; 3] {
    let hi = r.max(g).max(b);
    let lo = r.min(g).min(b);
    let spread = hi - lo;
    if spread <= 0.0 {
        return [0.0, 0.0, hi];
    }
    let sixths = if r == hi {
        (g - b) / spread
    } else if g == hi {
        2.0 + (b - r) / spread
    } else {
        4.0 + (r - g) / spread
    };
    [(sixths / 6.0).rem_euclid(1.0), spread / hi, hi]
}

fn srgb_from_hsv([h, s, v]: [f64; 3]) -> [f64; 3] {
    // Component n of the usual piecewise linear formula, n = 5, 3, 1 for red, green, blue.
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + h * 6.0).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

fn lab_from_srgb(srgb: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = srgb.map(linear_from_srgb);
    let xyz = [
        0.4124 * r + 0.3576 * g + 0.1805 * b,
        0.2126 * r + 0.7152 * g + 0.0722 * b,
        0.0193 * r + 0.1192 * g + 0.9505 * b,
    ];
    let [x, y, z] = [0, 1, 2].map(|c| {
        let ratio = xyz[c] / WHITE[c];
        if ratio > 0.008856 {
            ratio.cbrt()
        } else {
            7.787 * ratio + 16.0 / 116.0
        }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn srgb_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let y = (l + 16.0) / 116.0;
    let roots = [a / 500.0 + y, y, y - b / 200.0];
    let [x, y, z] = [0, 1, 2].map(|c| {
        let cube = roots[c].powi(3);
        let ratio = if cube > 0.008856 {
            cube
        } else {
            (roots[c] - 16.0 / 116.0) / 7.787
        };
        ratio * WHITE[c]
    });
    let linear = [
        3.2406 * x - 1.5372 * y - 0.4986 * z,
        -0.9689 * x + 1.8758 * y + 0.0415 * z,
        0.0557 * x - 0.2040 * y + 1.0570 * z,
    ];
    let encoded = linear.map(srgb_from_linear);
    // Colours outside the gamut dim until their largest component fits; negative ones become 0.
    let largest = encoded.into_iter().fold(1.0, f64::max);
    encoded.map(|c| (c / largest).clamp(0.0, 1.0))
}

/// Linear light to sRGB, for one component; negative light stays negative (IEC 61966-2-1).
pub fn srgb_from_linear(linear: f64) -> f64 {
    if linear <= 0.0031308 {
        12.92 * linear
    } else {
        1.055 * linear.powf(1.0 / 2.4) - 0.055
    }
}

fn msh_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let magnitude = (l * l + a * a + b * b).sqrt();
    let saturation = if magnitude > 0.001 {
        (l / magnitude).clamp(-1.0, 1.0).acos()
    } else {
        0.0
    };
    let hue = if saturation > 0.001 { b.atan2(a) } else { 0.0 };
    [magnitude, saturation, hue]
}

fn lab_from_msh([m, s, h]: [f64; 3]) -> [f64; 3] {
    [m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()]
}

/// Moreland, Figure 7: interpolation in Msh with white between saturated ends.
fn diverging(a: [f64; 3], b: [f64; 3], mut t: f64) -> [f64; 3] {
    let mut a = msh_from_lab(lab_from_srgb(a));
    let mut b = msh_from_lab(lab_from_srgb(b));
    let turn = (a[2] - b[2]).abs().rem_euclid(TAU);
    let turn = turn.min(TAU - turn);
    if a[1] > UNSATURATED && b[1] > UNSATURATED && turn > 0.33 * PI {
        let white = [a[0].max(b[0]).max(WHITE_MAGNITUDE), 0.0, 0.0];
        if t < 0.5 {
            b = white;
            t *= 2.0;
        } else {
            a = white;
            t = 2.0 * t - 1.0;
        }
    }
    if a[1] < UNSATURATED && b[1] > UNSATURATED {
        a[2] = hue_at_white(b, a[0]);
    } else if b[1] < UNSATURATED && a[1] > UNSATURATED {
        b[2] = hue_at_white(a, b[0]);
    }
    srgb_from_lab(lab_from_msh(lerp(a, b, t)))
}

/// The hue with which a saturated colour runs into a grey of the given magnitude (Moreland,
/// Figure 7, `AdjustHue`).
fn hue_at_white([m, s, h]: [f64; 3], grey_magnitude: f64) -> f64 {
    if m >= grey_magnitude - 0.1 {
        return h;
    }
    let spin = s * (grey_magnitude * grey_magnitude - m * m).sqrt() / (m * s.sin());
    if h > -0.3 * PI { h + spin } else { h - spin }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: [ColorSpace; 5] = [
        ColorSpace::Rgb,
        ColorSpace::Hsv,
        ColorSpace::HsvWrapped,
        ColorSpace::Lab,
        ColorSpace::Diverging,
    ];

    proptest! {
        #[test]
        fn ends_come_back_and_the_middle_is_a_color(
            a in [0.0f64..=1.0, 0.0f64..=1.0, 0.0f64..=1.0],
            b in [0.0f64..=1.0, 0.0f64..=1.0, 0.0f64..=1.0],
            t in 0.0f64..=1.0,
        ) {
            for space in ALL {
                for (end, t) in [(a, 0.0), (b, 1.0)] {
                    // Msh gives a near-grey end the hue of the other one, by definition.
                    let saturation = msh_from_lab(lab_from_srgb(end))[1];
                    if space == ColorSpace::Diverging && saturation < UNSATURATED {
                        continue;
                    }
                    let got = space.mix(a, b, t);
                    for c in 0..3 {
                        // The matrices to and from XYZ are inverse to four digits only.
                        prop_assert!((got[c] - end[c]).abs() < 2e-3, "{space:?} {got:?} {end:?}");
                    }
                }
                for c in space.mix(a, b, t) {
                    prop_assert!((-1e-12..=1.0 + 1e-12).contains(&c), "{space:?} {c}");
                }
            }
        }
    }

    #[test]
    fn near_greys_keep_their_magnitude() {
        let (near_grey, blue) = ([0.978, 0.945, 0.954], [0.0, 0.0, 0.256]);
        let [before, after] = [near_grey, ColorSpace::Diverging.mix(near_grey, blue, 0.0)]
            .map(|c| msh_from_lab(lab_from_srgb(c)));
        assert!((before[0] - after[0]).abs() < 0.1 && (before[1] - after[1]).abs() < 1e-3);
    }

    #[test]
    fn lightness_of_known_colors() {
        // CIE 1976: white has L* 100, red (sRGB) has L* 53.24, a* 80.09, b* 67.20.
        let white = lab_from_srgb([1.0; 3]);
        assert!((white[0] - 100.0).abs() < 1e-6 && white[1].abs() < 0.02 && white[2].abs() < 0.02);
        let red = lab_from_srgb([1.0, 0.0, 0.0]);
        for (got, expected) in red.into_iter().zip([53.24, 80.09, 67.20]) {
            assert!((got - expected).abs() < 0.05, "{red:?}");
        }
    }

    #[test]
    fn hue_wraps_only_where_asked() {
        let (magenta_red, yellow_red) = ([1.0, 0.0, 0.2], [1.0, 0.2, 0.0]);
        let wrapped = ColorSpace::HsvWrapped.mix(magenta_red, yellow_red, 0.5);
        assert!(wrapped[0] > 0.99 && wrapped[1] < 0.01 && wrapped[2] < 0.01);
        let long_way = ColorSpace::Hsv.mix(magenta_red, yellow_red, 0.5);
        assert!(long_way[0] < 0.01 && long_way[1] > 0.99, "{long_way:?}");
    }
}
