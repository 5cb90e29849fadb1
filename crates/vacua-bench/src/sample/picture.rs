//! Pictures from one plain integrator, the same for every way to hold a mesh: samples at equal
//! distances on a grid of the ray that starts at the camera, composited front to back, without skipping.

use glam::DVec3;
use rayon::prelude::*;
use vacua_pack::reference::RaySamples;
use vacua_render::{Camera, Projection};
use vacua_synth::BenchScene;
use vacua_volume::{Bounds, TransferTable};

use super::orders::RAYS;
use super::peers::Peer;
use crate::error::BenchError;

/// Distance between samples: half the edge of a cell of the benchmark scenes.
const STEP: f64 = 0.5;
/// Pixels a side of a tile, whose rays follow each other.
const TILE: usize = 8;

/// A ray of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Which pixel, row by row.
    pub pixel: usize,
    /// Its samples.
    pub samples: RaySamples,
    /// How many there are.
    pub count: usize,
}

/// The rays of a picture that meet the box around a mesh, tile by tile.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Pixels a side.
    pub pixels: usize,
    /// The rays.
    pub rays: Vec<Ray>,
}

impl Rays {
    /// The rays of a camera through a box. Places are relative to `origin`.
    ///
    /// # Errors
    /// [`BenchError::Camera`].
    pub fn new(
        scene: &BenchScene,
        bounds: Bounds,
        origin: [f64; 3],
        pixels: usize,
    ) -> Result<Self, BenchError> {
        let camera = camera(scene);
        let view = camera.view(bounds, pixels, pixels)?;
        let tiles = pixels.div_ceil(TILE);
        let mut rays = Vec::new();
        for i in 0..tiles * tiles * TILE * TILE {
            let (tile, within) = (i / (TILE * TILE), i % (TILE * TILE));
            let x = tile % tiles * TILE + within % TILE;
            let y = tile / tiles * TILE + within / TILE;
            if x >= pixels || y >= pixels {
                continue;
            }
            let (eye, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
            let a = (bounds.lo - eye) / direction;
            let b = (bounds.hi - eye) / direction;
            let enter = a.min(b).max_element().max(0.0);
            let leave = a.max(b).min_element();
            // Samples at multiples of the step from the camera on.
            let (first, last) = ((enter / STEP).ceil(), (leave / STEP).floor());
            if !(first <= last && last < f64::from(u32::MAX)) {
                continue;
            }
            let start = eye + first * STEP * direction - DVec3::from_array(origin);
            rays.push(Ray {
                pixel: y * pixels + x,
                samples: RaySamples {
                    start: start.to_array().map(|c| c as f32),
                    step: direction.to_array().map(|d| (STEP * d) as f32),
                    first: 0,
                },
                count: (last - first) as usize + 1,
            });
        }
        Ok(Self { pixels, rays })
    }

    /// Samples of all rays.
    pub fn num_samples(&self) -> usize {
        self.rays.iter().map(|ray| ray.count).sum()
    }
}

/// The camera of a scene.
pub(super) fn camera(scene: &BenchScene) -> Camera {
    Camera::Placed {
        eye: scene.camera.eye,
        at: scene.camera.at,
        up: scene.camera.up,
        projection: Projection::Perspective {
            fov_degrees: scene.camera.fov_deg,
        },
    }
}

/// A picture: linear, premultiplied.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Red, green, blue and alpha of each pixel, row by row.
    pub rgba: Vec<[f32; 4]>,
}

impl Picture {
    /// The largest difference of a channel.
    pub fn largest_difference(&self, other: &Self) -> f64 {
        let channels = self.rgba.iter().flatten().zip(other.rgba.iter().flatten());
        channels.fold(0.0, |most, (a, b)| f64::max(most, f64::from((a - b).abs())))
    }
}

/// Renders the picture of one peer.
pub(super) fn render(peer: &Peer, rays: &Rays, table: &TransferTable) -> Picture {
    let tiles: Vec<Vec<(usize, [f32; 4])>> = rays
        .rays
        .par_chunks(RAYS)
        .map(|rays| {
            let mut values = Vec::new();
            let of_ray = |ray: &Ray| {
                values.resize(ray.count, 0.0);
                peer.sample_ray(&ray.samples, &mut values);
                (ray.pixel, composite(&values, table))
            };
            rays.iter().map(of_ray).collect()
        })
        .collect();
    let mut rgba = vec![[0.0; 4]; rays.pixels * rays.pixels];
    for (pixel, color) in tiles.into_iter().flatten() {
        rgba[pixel] = color;
    }
    Picture { rgba }
}

/// What samples make of the light.
fn composite(values: &[f32], table: &TransferTable) -> [f32; 4] {
    let (mut color, mut through) = ([0.0f32; 3], 1.0f32);
    for &value in values.iter().filter(|v| !v.is_nan()) {
        let (extinction, rgb) = table.evaluate(value);
        if extinction > 0.0 {
            let alpha = -(-extinction * STEP as f32).exp_m1();
            for channel in 0..3 {
                color[channel] += through * alpha * rgb[channel];
            }
            through *= 1.0 - alpha;
        }
    }
    let [r, g, b] = color;
    [r, g, b, 1.0 - through]
}
