//! Transfer function and camera of the benchmark scenes, as plain data.

use glam::DVec3;
use vacua_volume::{ColorPoint, OpacityPoint, TransferFunction, TransferFunctionError, ValueScale};

/// A perspective camera, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchCamera {
    /// Where it stands.
    pub eye: DVec3,
    /// Where it looks.
    pub at: DVec3,
    /// What is up.
    pub up: DVec3,
    /// Full vertical field of view, in degrees.
    pub fov_deg: f64,
}

/// How the benchmark scenes `shells256`, `tet100` and `hex150` are looked at.
///
/// The transfer function is thin on purpose: rays cross everything, early termination hardly fires.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchScene {
    /// Colours and opacities; reference length 1 (a voxel, a cell edge).
    pub transfer_function: TransferFunction,
    /// The view: the bounding sphere of the cube just fits.
    pub camera: BenchCamera,
}

impl BenchScene {
    /// The scene around the cube `[0, side]³` of values in `0..=scale`; `side` is 255, 100 and 150
    /// for the three benchmark scenes, `scale` is 1.
    ///
    /// # Errors
    /// [`TransferFunctionError`] if `scale` is not positive and finite.
    pub fn new(side: f64, scale: f64) -> Result<Self, TransferFunctionError> {
        const FOV_DEG: f64 = 20.0;
        let at = DVec3::splat(0.5 * side);
        let radius = 0.5 * side * 3f64.sqrt();
        let distance = radius / (0.5 * FOV_DEG).to_radians().sin();
        Ok(Self {
            transfer_function: Self::transfer_function(scale)?,
            camera: BenchCamera {
                eye: at + distance * DVec3::new(0.8, 0.5, 1.0).normalize(),
                at,
                up: DVec3::Y,
                fov_deg: FOV_DEG,
            },
        })
    }

    /// The transfer function for values in `0..=scale`.
    ///
    /// # Errors
    /// [`TransferFunctionError`] if `scale` is not positive and finite.
    pub fn transfer_function(scale: f64) -> Result<TransferFunction, TransferFunctionError> {
        const POINTS: [(f64, f64, [f64; 3]); 5] = [
            (0.0, 0.0, [0.0, 0.0, 1.0]),
            (0.25, 0.0, [0.0, 0.4, 1.0]),
            (0.30, 0.01, [0.0, 1.0, 0.6]),
            (0.70, 0.03, [1.0, 0.8, 0.0]),
            (1.0, 0.06, [1.0, 0.1, 0.0]),
        ];
        let colors = POINTS.map(|(value, _, srgb)| ColorPoint {
            value: value * scale,
            srgb,
        });
        let opacities = POINTS.map(|(value, opacity, _)| OpacityPoint {
            value: value * scale,
            opacity,
        });
        TransferFunction::new(colors.into(), opacities.into(), 1.0, ValueScale::Linear)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_is_the_published_one() {
        let BenchCamera {
            eye,
            at,
            up,
            fov_deg,
        } = BenchScene::new(1.0, 1.0).expect("valid").camera;
        let forward = (at - eye).normalize();
        let right = forward.cross(up).normalize();
        let up = right.cross(forward);
        let half = (0.5 * fov_deg).to_radians().tan();
        let (mut hits, mut chords) = (0, 0.0);
        const SIDE: usize = 512;
        for pixel in 0..SIDE * SIDE {
            let place = |i: usize| half * (2.0 * (i as f64 + 0.5) / SIDE as f64 - 1.0);
            let direction =
                (forward + place(pixel % SIDE) * right + place(pixel / SIDE) * up).normalize();
            let (a, b) = (-eye / direction, (DVec3::ONE - eye) / direction);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
            if enter < leave {
                hits += 1;
                chords += leave - enter;
            }
        }
        // The README of the benchmark: 54.4 % of the pixels hit the box, mean chord 0.60 n.
        let share = f64::from(hits) / (SIDE * SIDE) as f64;
        assert!((share - 0.544).abs() < 5e-4, "{share}");
        assert!((chords / f64::from(hits) - 0.60).abs() < 5e-3);
    }
}
