//! Cameras: from a description (`orbit`, `eye/at/up`) to rays through pixels.

use glam::DVec3;
use vacua_volume::Bounds;

/// How rays spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// From one point; `fov_degrees` is the vertical field of view.
    Perspective {
        /// Vertical field of view in degrees, between 0 and 180.
        fov_degrees: f64,
    },
    /// In parallel; `height` is that of the picture in world units.
    Orthographic {
        /// Height of the picture in world units.
        height: f64,
    },
}

/// A camera, before or after it knows what it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Camera {
    /// Placed in the world.
    Placed {
        /// Where it is.
        eye: DVec3,
        /// What it looks at.
        at: DVec3,
        /// What is up in the picture.
        up: DVec3,
        /// How rays spread.
        projection: Projection,
    },
    /// Around the centre of the data, at the distance where its bounding sphere just fits.
    Orbit {
        /// Degrees around the vertical axis (y up); 0 looks along −z, 90 along −x.
        azimuth_degrees: f64,
        /// Degrees above the horizontal plane.
        elevation_degrees: f64,
    },
}

/// Field of view of an orbiting camera in degrees.
const ORBIT_FOV_DEGREES: f64 = 30.0;

impl Camera {
    /// Around the centre of the data; angles in degrees.
    pub fn orbit(azimuth_degrees: f64, elevation_degrees: f64) -> Self {
        Self::Orbit {
            azimuth_degrees,
            elevation_degrees,
        }
    }

    /// From a direction towards the centre of a box, at the distance where its bounding sphere
    /// just fits the field of view.
    pub fn framing(bounds: Bounds, from: DVec3, up: DVec3, fov_degrees: f64) -> Self {
        let radius = 0.5 * bounds.diagonal();
        let distance = radius / (0.5 * fov_degrees.to_radians()).sin();
        Self::Placed {
            eye: bounds.center() + from.normalize() * distance,
            at: bounds.center(),
            up,
            projection: Projection::Perspective { fov_degrees },
        }
    }

    /// Settles the camera for data within `bounds` and a picture of some size.
    ///
    /// # Errors
    /// [`CameraError`] if eye and target coincide, or a number makes no sense.
    pub fn view(&self, bounds: Bounds, width: usize, height: usize) -> Result<View, CameraError> {
        let (eye, at, up, projection) = match *self {
            Self::Placed {
                eye,
                at,
                up,
                projection,
            } => (eye, at, up, projection),
            Self::Orbit {
                azimuth_degrees,
                elevation_degrees,
            } => {
                let (sin_a, cos_a) = azimuth_degrees.to_radians().sin_cos();
                let (sin_e, cos_e) = elevation_degrees.to_radians().sin_cos();
                let from = DVec3::new(sin_a * cos_e, sin_e, cos_a * cos_e);
                // Straight from above or below, the picture's up is what lies behind.
                let up = DVec3::new(-sin_a * sin_e, cos_e, -cos_a * sin_e);
                match Self::framing(bounds, from, up, ORBIT_FOV_DEGREES) {
                    Self::Placed {
                        eye,
                        at,
                        up,
                        projection,
                    } => (eye, at, up, projection),
                    Self::Orbit { .. } => return Err(CameraError::NotFinite),
                }
            }
        };
        let forward = at - eye;
        if !(eye.is_finite() && at.is_finite() && up.is_finite()) {
            return Err(CameraError::NotFinite);
        }
        let forward = forward.try_normalize().ok_or(CameraError::NowhereToLook)?;
        let right = forward
            .cross(up)
            .try_normalize()
            .unwrap_or(forward.any_orthonormal_vector());
        let half_height = match projection {
            Projection::Perspective { fov_degrees } if fov_degrees > 0.0 && fov_degrees < 180.0 => {
                (0.5 * fov_degrees.to_radians()).tan()
            }
            Projection::Orthographic { height } if height > 0.0 && height.is_finite() => {
                0.5 * height
            }
            Projection::Perspective { fov_degrees } => {
                return Err(CameraError::FieldOfView(fov_degrees));
            }
            Projection::Orthographic { height } => return Err(CameraError::Height(height)),
        };
        let aspect = width as f64 / height as f64;
        Ok(View {
            eye,
            forward,
            right: right * half_height * aspect,
            up: right.cross(forward) * half_height,
            parallel: matches!(projection, Projection::Orthographic { .. }),
            pixel: [2.0 / width as f64, 2.0 / height as f64],
        })
    }
}

/// Why a camera sees nothing at all.
#[derive(Clone, Copy, Debug, thiserror::Error, PartialEq)]
pub enum CameraError {
    /// Eye and target are one point.
    #[error("the camera looks at the point where it is")]
    NowhereToLook,
    /// A coordinate is not finite.
    #[error("a coordinate of the camera is not finite")]
    NotFinite,
    /// A field of view beyond half of everything.
    #[error("a field of view of {0}°, it must be between 0 and 180")]
    FieldOfView(f64),
    /// An orthographic picture without height.
    #[error("an orthographic picture {0} high, it must be positive")]
    Height(f64),
}

/// A camera with everything settled: makes rays.
#[derive(Clone, Copy, Debug)]
pub struct View {
    eye: DVec3,
    forward: DVec3,
    /// From the middle of the picture to its right edge, at distance 1 (perspective).
    right: DVec3,
    /// From the middle of the picture to its upper edge.
    up: DVec3,
    parallel: bool,
    pixel: [f64; 2],
}

impl View {
    /// The ray through a point of the picture, in pixels from its upper left corner: origin and
    /// unit direction in world space.
    #[inline(always)]
    pub fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let across = self.right * (x * self.pixel[0] - 1.0) + self.up * (1.0 - y * self.pixel[1]);
        if self.parallel {
            (self.eye + across, self.forward)
        } else {
            (self.eye, (self.forward + across).normalize())
        }
    }

    /// As [`View::ray`] for many points at once, an array a coordinate; loops without branches, so
    /// that they become vector code.
    #[inline(always)]
    pub(crate) fn rays<const N: usize>(
        &self,
        x: &[f64; N],
        y: &[f64; N],
    ) -> ([[f64; N]; 3], [[f64; N]; 3]) {
        let (eye, forward) = (self.eye.to_array(), self.forward.to_array());
        let (right, up) = (self.right.to_array(), self.up.to_array());
        let (mut origin, mut direction) = ([[0.0; N]; 3], [[0.0; N]; 3]);
        for a in 0..3 {
            for i in 0..N {
                let across =
                    right[a] * (x[i] * self.pixel[0] - 1.0) + up[a] * (1.0 - y[i] * self.pixel[1]);
                if self.parallel {
                    origin[a][i] = eye[a] + across;
                    direction[a][i] = forward[a];
                } else {
                    origin[a][i] = eye[a];
                    direction[a][i] = forward[a] + across;
                }
            }
        }
        if !self.parallel {
            for i in 0..N {
                let [x, y, z] = [direction[0][i], direction[1][i], direction[2][i]];
                let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
                for axis in &mut direction {
                    axis[i] *= inverse;
                }
            }
        }
        (origin, direction)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Bounds = Bounds {
        lo: DVec3::ZERO,
        hi: DVec3::ONE,
    };

    #[test]
    fn the_middle_ray_looks_at_the_target() {
        let camera = Camera::orbit(30.0, 20.0);
        let view = camera.view(UNIT, 100, 50).expect("a good camera");
        let (origin, direction) = view.ray(50.0, 25.0);
        let to_center = (DVec3::splat(0.5) - origin).normalize();
        assert!((direction - to_center).length() < 1e-12);
        let (_, right) = view.ray(75.0, 25.0);
        let (_, up) = view.ray(50.0, 10.0);
        assert!(up.y > direction.y);
        assert!((right - direction).dot(direction.cross(DVec3::Y)) > 0.0);
    }

    #[test]
    fn parallel_rays_are_parallel() {
        let camera = Camera::Placed {
            eye: DVec3::new(0.5, 0.5, 5.0),
            at: DVec3::splat(0.5),
            up: DVec3::Y,
            projection: Projection::Orthographic { height: 2.0 },
        };
        let view = camera.view(UNIT, 10, 10).expect("a good camera");
        let (a, d) = view.ray(0.0, 0.0);
        let (b, e) = view.ray(10.0, 10.0);
        assert_eq!(d, e);
        assert!((a - DVec3::new(-0.5, 1.5, 5.0)).length() < 1e-12, "{a}");
        assert!((b - DVec3::new(1.5, -0.5, 5.0)).length() < 1e-12, "{b}");
    }

    #[test]
    fn senseless_cameras_are_refused() {
        let placed = |eye, fov_degrees| Camera::Placed {
            eye,
            at: DVec3::ZERO,
            up: DVec3::Y,
            projection: Projection::Perspective { fov_degrees },
        };
        let error = |c: Camera| c.view(UNIT, 10, 10).expect_err("no such camera");
        assert_eq!(error(placed(DVec3::ZERO, 30.0)), CameraError::NowhereToLook);
        assert_eq!(
            error(placed(DVec3::ONE, 180.0)),
            CameraError::FieldOfView(180.0)
        );
        assert_eq!(
            error(placed(DVec3::splat(f64::NAN), 30.0)),
            CameraError::NotFinite
        );
        assert!(placed(DVec3::Y, 30.0).view(UNIT, 10, 10).is_ok());
    }
}
