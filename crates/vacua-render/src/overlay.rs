//! The boundary of the active macrocells drawn over a picture: the edges of its faces, those that
//! are nearest to the camera.
//!
//! Each pixel's ray finds the first face; how far its point is from the edges of the face is
//! measured in pixels, by where the rays of the next pixels meet the plane of the face.

use glam::{DAffine3, DVec3};
use rayon::prelude::*;
use vacua_skip::{BoundaryHit, Lattice, MeshSkip};

use crate::camera::View;
use crate::frame::Frame;

/// Linear-light colour of the lines.
const COLOR: [f32; 3] = [0.8, 0.12, 0.02];
/// Opacity of the lines.
const OPACITY: f32 = 0.8;
/// Half the width of a line in pixels.
const HALF_WIDTH: f64 = 0.7;

/// Draws the boundary of a mask over a picture that was made with a view.
pub(crate) fn draw_boundary(
    frame: &mut Frame,
    view: &View,
    ray_from_world: DAffine3,
    lattice: &Lattice,
    boundary: &MeshSkip,
) {
    let ray = |x: usize, y: usize| {
        let (origin, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
        (
            ray_from_world.transform_point3(origin),
            ray_from_world.transform_vector3(direction),
        )
    };
    let width = frame.width;
    let rows = frame.rgba.par_chunks_mut(width).enumerate();
    rows.for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let (origin, direction) = ray(x, y);
            let Some(hit) = boundary.first_hit(origin.to_array(), direction.to_array()) else {
                continue;
            };
            let beside = [ray(x + 1, y), ray(x, y + 1)].map(|ray| on_plane(&hit, ray));
            let distance = distance_from_edges(&hit, beside, lattice);
            let cover = OPACITY * (HALF_WIDTH + 0.5 - distance).clamp(0.0, 1.0) as f32;
            for c in 0..4 {
                let line = COLOR.get(c).copied().unwrap_or(1.0);
                pixel[c] = line * cover + pixel[c] * (1.0 - cover);
            }
        }
    });
}

/// Where a ray meets the plane of a face.
fn on_plane(hit: &BoundaryHit, (origin, direction): (DVec3, DVec3)) -> DVec3 {
    let t = (hit.position[hit.axis] - origin[hit.axis]) / direction[hit.axis];
    origin + t * direction
}

/// Pixels from a point to the nearest edge of its macrocell's face.
fn distance_from_edges(hit: &BoundaryHit, beside: [DVec3; 2], lattice: &Lattice) -> f64 {
    let mut nearest = f64::INFINITY;
    for axis in [(hit.axis + 1) % 3, (hit.axis + 2) % 3] {
        let at = hit.position[axis];
        let per_pixel = (beside[0][axis] - at).hypot(beside[1][axis] - at);
        let macrocell = lattice.macrocell_of(axis, at as f32);
        for plane in [macrocell, macrocell + 1] {
            let apart = (at - f64::from(lattice.plane(axis, plane))).abs();
            nearest = nearest.min(apart / per_pixel);
        }
    }
    nearest
}
