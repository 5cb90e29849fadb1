//! The transfer functions of the stand-ins.

use vacua_volume::{ColorPoint, OpacityPoint, TransferFunction, TransferFunctionError, ValueScale};

use crate::kind::Kind;

type Opacities = &'static [(f64, f64)];
type Colors = &'static [(f64, [f64; 3])];

const GREY: Colors = &[(0.0, [0.2; 3]), (1.0, [0.95; 3])];

const FIRE: Colors = &[
    (0.0, [0.1, 0.1, 0.2]),
    (0.35, [0.6, 0.1, 0.05]),
    (0.6, [0.95, 0.5, 0.1]),
    (1.0, [1.0, 0.95, 0.7]),
];

const PETALS: Colors = &[
    (0.0, [0.2, 0.35, 0.2]),
    (0.35, [0.85, 0.35, 0.55]),
    (0.7, [0.95, 0.65, 0.75]),
    (1.0, [1.0, 0.9, 0.5]),
];

const COOL_WARM: Colors = &[
    (0.0, [0.23, 0.30, 0.75]),
    (0.5, [0.86, 0.86, 0.86]),
    (1.0, [0.71, 0.02, 0.15]),
];

const BLOBS: Colors = &[
    (0.0, [0.2, 0.3, 0.5]),
    (0.43, [0.3, 0.6, 0.9]),
    (0.72, [0.95, 0.6, 0.2]),
    (1.0, [1.0, 0.95, 0.6]),
];

/// The transfer functions of a kind for values in `0..=scale`, opacities per voxel; the first is
/// the default.
pub(crate) fn looks(
    kind: Kind,
    scale: f64,
) -> Result<Vec<(&'static str, TransferFunction)>, TransferFunctionError> {
    let looks: &[(&'static str, Colors, Opacities)] = match kind {
        Kind::Heptane => &[(
            "default",
            FIRE,
            &[(0.0, 0.0), (0.3, 0.0), (0.5, 0.02), (1.0, 0.12)],
        )],
        Kind::Flower => &[(
            "default",
            PETALS,
            &[(0.0, 0.0), (0.2, 0.0), (0.5, 0.03), (1.0, 0.1)],
        )],
        Kind::Dns => &[(
            "default",
            COOL_WARM,
            &[(0.0, 0.0), (0.745, 0.0), (0.82, 0.02), (1.0, 0.1)],
        )],
        Kind::Llnl => &[(
            "default",
            COOL_WARM,
            &[(0.0, 0.0), (0.2, 0.0), (0.5, 0.04), (0.8, 0.0), (1.0, 0.0)],
        )],
        Kind::Blobs => &[
            (
                "default",
                BLOBS,
                &[
                    (0.0, 0.0),
                    (0.41, 0.0),
                    (0.43, 0.015),
                    (0.45, 0.0),
                    (0.67, 0.0),
                    (0.72, 0.1),
                    (1.0, 0.3),
                ],
            ),
            (
                "haze",
                BLOBS,
                &[
                    (0.0, 0.0),
                    (0.02, 0.0),
                    (0.2, 0.002),
                    (0.7, 0.01),
                    (1.0, 0.2),
                ],
            ),
        ],
        _ => &[("default", GREY, &[(0.0, 0.02), (1.0, 0.02)])],
    };
    looks
        .iter()
        .map(|(name, colors, opacities)| {
            let colors = colors
                .iter()
                .map(|&(value, srgb)| ColorPoint {
                    value: value * scale,
                    srgb,
                })
                .collect();
            let opacities = opacities
                .iter()
                .map(|&(value, opacity)| OpacityPoint {
                    value: value * scale,
                    opacity,
                })
                .collect();
            let function = TransferFunction::new(colors, opacities, 1.0, ValueScale::Linear)?;
            Ok((*name, function))
        })
        .collect()
}
