//! Pictures from one plain integrator, the same for every way to hold a mesh: samples at equal
//! distances on a grid of the ray that starts at the camera, composited front to back, without skipping.

use glam::DVec3;
use rayon::prelude::*;
use vacua_pack::reference::RaySamples;
use vacua_render::{Camera, Projection};
use vacua_synth::BenchScene;
use vacua_volume::{Bounds, TransferTable};

use super::peers::Peer;
use crate::error::BenchError;

/// Distance between samples: half the edge of a cell of the benchmark scenes.
const STEP: f64 = 0.5;
/// Pixels a side of a tile.
pub(super) const TILE: usize = 8;
/// Samples of a ray at most.
const MOST_SAMPLES: u32 = 1 << 24;

/// Rays of a tile at most.
pub(super) const TILE_RAYS: usize = TILE * TILE;

/// The rays of a tile, row by row, that count their samples from a common distance on.
#[derive(Clone, Debug)]
pub struct Tile {
    /// Which pixels.
    pub pixels: [usize; TILE_RAYS],
    /// Where samples are; none where a ray misses.
    pub rays: [RaySamples; TILE_RAYS],
    /// How many samples each ray has.
    pub counts: [u32; TILE_RAYS],
}

impl Tile {
    /// Samples of all its rays.
    pub fn num_samples(&self) -> usize {
        self.counts.iter().map(|&n| n as usize).sum()
    }
}

/// The rays of a picture that meet the box around a mesh.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Pixels a side.
    pub pixels: usize,
    /// The tiles that any ray of meets it.
    pub tiles: Vec<Tile>,
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
        let view = camera(scene).view(bounds, pixels, pixels)?;
        let a_side = pixels.div_ceil(TILE);
        let mut tiles = Vec::new();
        for number in 0..a_side * a_side {
            // Eye, direction and numbers of the first and last sample.
            let mut found = [None; TILE_RAYS];
            let mut pixels_of = [0; TILE_RAYS];
            for (i, found) in found.iter_mut().enumerate() {
                let x = number % a_side * TILE + i % TILE;
                let y = number / a_side * TILE + i / TILE;
                if x >= pixels || y >= pixels {
                    continue;
                }
                pixels_of[i] = y * pixels + x;
                let (eye, direction) = view.ray(x as f64 + 0.5, y as f64 + 0.5);
                let a = (bounds.lo - eye) / direction;
                let b = (bounds.hi - eye) / direction;
                let enter = a.min(b).max_element().max(0.0);
                let leave = a.max(b).min_element();
                // Samples at multiples of the step from the camera on.
                let (first, last) = ((enter / STEP).ceil(), (leave / STEP).floor());
                *found = (first <= last && last - first < f64::from(MOST_SAMPLES))
                    .then_some((eye, direction, first, last));
            }
            let firsts = found.iter().flatten().map(|ray| ray.2);
            let base = firsts.fold(f64::INFINITY, f64::min);
            if base == f64::INFINITY {
                continue;
            }
            let mut tile = Tile {
                pixels: pixels_of,
                rays: [RaySamples::default(); TILE_RAYS],
                counts: [0; TILE_RAYS],
            };
            for (i, ray) in found.into_iter().enumerate() {
                let Some((eye, direction, first, last)) = ray else {
                    continue;
                };
                let start = eye + base * STEP * direction - DVec3::from_array(origin);
                tile.rays[i] = RaySamples {
                    start: start.to_array().map(|c| c as f32),
                    step: direction.to_array().map(|d| (STEP * d) as f32),
                    first: (first - base) as u32,
                };
                tile.counts[i] = (last - first) as u32 + 1;
            }
            tiles.push(tile);
        }
        Ok(Self { pixels, tiles })
    }

    /// Samples of all rays.
    pub fn num_samples(&self) -> usize {
        self.tiles.iter().map(Tile::num_samples).sum()
    }

    /// Every so many tiles.
    pub fn every(&self, nth: usize) -> Self {
        Self {
            pixels: self.pixels,
            tiles: self.tiles.iter().step_by(nth.max(1)).cloned().collect(),
        }
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
    let tiles: Vec<[[f32; 4]; TILE_RAYS]> = rays
        .tiles
        .par_iter()
        .map(|tile| {
            let mut values = Vec::new();
            peer.sample_tile(tile, &mut values);
            let mut rest = &values[..];
            let mut colors = [[0.0; 4]; TILE_RAYS];
            for (color, &count) in colors.iter_mut().zip(&tile.counts) {
                let (of_ray, more) = rest.split_at(count as usize);
                *color = composite(of_ray, table);
                rest = more;
            }
            colors
        })
        .collect();
    let mut rgba = vec![[0.0; 4]; rays.pixels * rays.pixels];
    for (tile, colors) in rays.tiles.iter().zip(tiles) {
        for i in (0..TILE_RAYS).filter(|&i| tile.counts[i] > 0) {
            rgba[tile.pixels[i]] = colors[i];
        }
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
