//! One pass over the picture: bands of rows in parallel, small tiles within a band so that
//! neighbouring rays find each other's voxels in the cache.

use std::marker::PhantomData;

use rayon::prelude::*;
use vacua_simd::{Kernel, Simd, dispatch};
use vacua_skip::{Lattice, Skipper};
use vacua_volume::{Association, TransferTable};

use crate::blocks::{Partition, Strides};
use crate::frame::Frame;
use crate::lift::Lift;
use crate::march::{Composite, Composited, Largest, Maximum, RayResult};
use crate::sampler::{CellSampler, Grid, PointSampler, Sampler};
use crate::scene::{Detail, Integrator, Shading};
use crate::setup::{RaySetup, TILE, TILE_RAYS, TilePixels, TileRays};
use crate::stage::VolumeStage;
use crate::voxels::Voxels;

/// Everything that a pass needs to know.
#[derive(Clone, Copy)]
pub(crate) struct Pass<'a> {
    pub setup: &'a RaySetup,
    pub lattice: &'a Lattice,
    pub strides: &'a Strides,
    pub skipper: &'a dyn Skipper,
    pub table: &'a TransferTable,
    pub threshold: f32,
    pub integrator: Integrator,
    pub detail: Detail,
    pub shading: Shading,
    pub termination: f32,
    /// Number of the frame among those that are averaged.
    pub frame: u32,
    /// Where in the pixel rays go through, in pixels from its upper left corner.
    pub offset: [f64; 2],
    /// Every how many tiles one is rendered: 1 for a picture, more for a measurement.
    pub every: usize,
}

/// Renders all rays of a pass into a frame.
pub(crate) fn render_pass(pass: Pass<'_>, volume: &VolumeStage, frame: &mut Frame) {
    let scalars = volume.data.scalars();
    let map = volume.wide_map();
    if let Some(cells) = &volume.packed {
        match pass.detail {
            Detail::Exact => bands(pass, &cells.sampler(map), frame),
            Detail::Level(level) => bands(pass, &cells.sampler_of(level, volume.map), frame),
        }
        return;
    }
    let association = volume.data.association();
    let blanked_cells = volume.data.blanked_cells();
    let axes = &volume.space.axes;
    let grid = Grid {
        axes,
        voxels: match association {
            Association::Point if volume.plain => Voxels::plain(scalars),
            // Of cells numbers are shown as they are, not interpolated.
            Association::Point | Association::Cell => Voxels::of(scalars),
        },
        bytes: scalars.bytes(),
        plain: volume.plain,
        lift: Lift::for_range(volume.range),
        map,
        blanked_cells,
    };
    match association {
        Association::Point => bands(pass, &PointSampler::new(grid), frame),
        Association::Cell => bands(pass, &CellSampler::new(grid), frame),
    }
}

fn bands<V: Sampler>(pass: Pass<'_>, sampler: &V, frame: &mut Frame) {
    let width = frame.width;
    let band = TILE * width;
    let rgba = frame.rgba.par_chunks_mut(band);
    let depth = frame.depth.par_chunks_mut(band);
    let samples = frame.samples.par_chunks_mut(band);
    rgba.zip(depth)
        .zip(samples)
        .enumerate()
        .for_each(|(i, ((rgba, depth), samples))| {
            dispatch(Band {
                pass,
                sampler,
                width,
                y0: i * TILE,
                rgba,
                depth,
                samples,
            });
        });
}

/// A few rows of the picture.
struct Band<'a, V> {
    pass: Pass<'a>,
    sampler: &'a V,
    width: usize,
    y0: usize,
    rgba: &'a mut [[f32; 4]],
    depth: &'a mut [f32],
    samples: &'a mut [u32],
}

impl<V: Sampler> Kernel for Band<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let rows = self.rgba.len() / self.width;
        for x0 in (0..self.width).step_by(TILE) {
            if !(x0 / TILE + 7 * (self.y0 / TILE)).is_multiple_of(self.pass.every) {
                continue;
            }
            let pixels = TilePixels {
                x0,
                y0: self.y0,
                columns: TILE.min(self.width - x0),
                rows,
                offset: self.pass.offset,
                frame: self.pass.frame,
            };
            let tile = self.pass.setup.tile(pixels);
            let results = match &tile {
                Some(tile) => march::<S, V>(&self.pass, self.sampler, tile),
                None => [RayResult::NOTHING; TILE_RAYS],
            };
            for i in 0..rows * TILE {
                if i % TILE < pixels.columns {
                    let to = i / TILE * self.width + x0 + i % TILE;
                    let depth = results[i].depth_sample.zip(tile.as_ref());
                    self.rgba[to] = results[i].rgba;
                    self.depth[to] = depth.map_or(f32::INFINITY, |(k, t)| t.t_of(i, k) as f32);
                    self.samples[to] = results[i].samples;
                }
            }
        }
    }
}

/// Marches the rays of a tile.
#[inline(always)]
fn march<S: Simd, V: Sampler>(
    pass: &Pass<'_>,
    sampler: &V,
    tile: &TileRays,
) -> [RayResult; TILE_RAYS] {
    let partition = Partition {
        tile,
        axes: pass.lattice.axes(),
        strides: pass.strides,
    };
    let mut results = [RayResult::NOTHING; TILE_RAYS];
    match pass.integrator {
        Integrator::March => {
            let lights = match pass.shading {
                Shading::None => None,
                Shading::Gradient => Some(pass.setup.lights(tile)),
            };
            let visit = Composite {
                sampler,
                tile,
                table: pass.table,
                termination: pass.termination,
                lights: lights.as_ref(),
                simd: PhantomData::<S>,
            };
            let mut states = [Composited::new(); TILE_RAYS];
            let samples = partition.visit(pass.skipper, &visit, &mut states);
            for i in 0..TILE_RAYS {
                results[i] = states[i].finish(samples[i]);
            }
        }
        Integrator::MaximumIntensity => {
            let visit = Maximum {
                sampler,
                tile,
                simd: PhantomData::<S>,
            };
            let mut states = [Largest::<S>::new(pass.threshold); TILE_RAYS];
            let samples = partition.visit(pass.skipper, &visit, &mut states);
            for i in 0..TILE_RAYS {
                results[i] = states[i].finish(pass.table, samples[i]);
            }
        }
    }
    results
}
