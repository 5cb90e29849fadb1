//! One pass over the picture: bands of rows in parallel, small tiles within a band so that
//! neighbouring rays find each other's voxels in the cache.

use rayon::prelude::*;
use vacua_simd::{Kernel, Simd, dispatch};
use vacua_skip::{Lattice, Skipper};
use vacua_volume::{Association, TransferTable};

use crate::blocks::{Partition, Strides};
use crate::curvilinear::CurvilinearSampler;
use crate::frame::Frame;
use crate::march::{Composite, Maximum, RayResult};
use crate::sampler::{CellSampler, Grid, PointSampler, Sampler, Voxels};
use crate::scene::{Integrator, Shading};
use crate::setup::RaySetup;
use crate::stage::VolumeStage;

/// Pixels a side of a tile, and rows of a band.
pub(crate) const TILE: usize = 8;

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
    let scalars = volume.volume.scalars();
    if let Some(cells) = &volume.curvilinear {
        let values = volume.cell_values();
        bands(pass, &CurvilinearSampler { cells, values }, frame);
        return;
    }
    let map = volume.wide_map();
    let blanked_cells = volume.volume.blanked_cells().map(|m| &**m);
    let axes = &volume.space.axes;
    let grid = Grid {
        axes,
        voxels: Voxels::of(scalars),
        map,
        blanked_cells,
    };
    match volume.volume.association() {
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
            for row in 0..rows {
                for x in x0..(x0 + TILE).min(self.width) {
                    let y = self.y0 + row;
                    let i = row * self.width + x;
                    let jitter = self.pass.setup.jitter_of(x, y, self.pass.frame);
                    let at = [
                        x as f64 + self.pass.offset[0],
                        y as f64 + self.pass.offset[1],
                    ];
                    let setup = self.pass.setup;
                    let Some(ray) = setup.ray(self.pass.lattice, at[0], at[1], jitter) else {
                        self.rgba[i] = [0.0; 4];
                        self.depth[i] = f32::INFINITY;
                        self.samples[i] = 0;
                        continue;
                    };
                    let result = march::<S, V>(&self.pass, self.sampler, &ray);
                    self.rgba[i] = result.rgba;
                    self.depth[i] = result
                        .depth_sample
                        .map_or(f32::INFINITY, |k| ray.t_of(k) as f32);
                    self.samples[i] = result.samples;
                }
            }
        }
    }
}

/// Marches one ray.
#[inline(always)]
fn march<S: Simd, V: Sampler>(
    pass: &Pass<'_>,
    sampler: &V,
    prepared: &crate::setup::PreparedRay,
) -> RayResult {
    let ray = &prepared.ray;
    let axes = pass.lattice.axes();
    let partition = Partition {
        ray,
        axes,
        strides: pass.strides,
        rates: prepared.rates,
    };
    match pass.integrator {
        Integrator::March => {
            let light = match pass.shading {
                Shading::None => None,
                Shading::Gradient => Some(pass.setup.light(prepared.direction)),
            };
            let dt = prepared.dt as f32;
            let mut visit =
                Composite::<S, V>::new(sampler, ray, pass.table, dt, pass.termination, light);
            partition.visit(pass.skipper, &mut visit);
            visit.finish()
        }
        Integrator::MaximumIntensity => {
            let mut visit = Maximum::<S, V>::new(sampler, ray, pass.threshold);
            partition.visit(pass.skipper, &mut visit);
            visit.finish(pass.table)
        }
    }
}
