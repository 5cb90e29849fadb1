//! Measures one mesh.

use std::sync::Arc;

use vacua_pack::EncodeOptions as PackOptions;
use vacua_pack::reference::{Cells, Reference};
use vacua_render::{CpuRenderer, RenderSettings, Renderer, Scene as RenderScene, SkipMethod};
use vacua_synth::BenchScene;
use vacua_volume::{Bounds, Dataset, TransferTable, ValueMap, ValueRange};

use super::orders::{self, NO_CLOCK, Order, Work};
use super::peers::{Kind, Peer};
use super::picture::{self, Picture, Rays};
use super::{FrameResult, PeerResult, Rate, SampleOptions, SceneResult};
use crate::cell::Cell;
use crate::encode::check_memory;
use crate::error::BenchError;
use crate::meshes::{self, Packed, Scene, VARIANTS};
use crate::timing::{Took, clocked, medians, timed};

/// Ray order is measured on every so many tiles of the picture, which is enough.
const EVERY_TILE: usize = 7;

/// Everything about one mesh.
pub(super) fn scene(model: Scene, options: &SampleOptions) -> SceneResult {
    measured(model, options).unwrap_or_else(|e| SceneResult {
        model,
        size: options.size.of(model.0),
        cells: Cell::empty(e.to_string()),
        samples: 0,
        peers: Vec::new(),
        frames: Vec::new(),
    })
}

/// What all pictures of a mesh have in common.
pub(super) struct Stage {
    pub scene: BenchScene,
    pub table: TransferTable,
    pub bounds: Bounds,
}

impl Stage {
    pub fn new(packed: &Packed, size: usize) -> Result<Self, BenchError> {
        let scene = BenchScene::new(size as f64, 1.0)?;
        let data_range = packed.field.values().range(0);
        let data_range = data_range.unwrap_or(ValueRange { lo: 0.0, hi: 1.0 });
        let bounds = packed.encoded.mesh.bounds().ok_or(BenchError::Option {
            option: "model",
            actual: "without a cell".to_owned(),
            expected: "a mesh with cells",
        })?;
        Ok(Self {
            table: TransferTable::new(&scene.transfer_function, data_range, ValueMap::IDENTITY),
            bounds,
            scene,
        })
    }

    pub fn rays(&self, packed: &Packed, pixels: usize) -> Result<Rays, BenchError> {
        Rays::new(
            &self.scene,
            self.bounds,
            packed.encoded.mesh.origin(),
            pixels,
        )
    }
}

/// A reference with the seconds it took to build, or why there is none.
type Built = (Kind, Result<(Box<dyn Reference>, f64), String>);

/// Builds a reference if memory suffices.
pub(super) fn build(kind: Kind, cells: &Cells) -> Result<(Box<dyn Reference>, f64), String> {
    tracing::info!(name = kind.name(), "building a reference");
    let needed = kind.build_bytes_per_cell() * cells.cells().len() as u64;
    check_memory(kind.name(), needed).map_err(|e| e.to_string())?;
    let (built, secs) = timed(|| kind.build(cells));
    Ok((built.map_err(|e| e.to_string())?, secs))
}

fn measured(model: Scene, options: &SampleOptions) -> Result<SceneResult, BenchError> {
    let Scene(kind) = model;
    tracing::info!(%kind, "making a mesh");
    let dataset = options.size.make(kind)?;
    let mesh = meshes::mesh(&dataset)?;
    let volume = meshes::volume(&dataset)?;
    let mut variants = Vec::new();
    for (variant, name) in VARIANTS {
        let pack_options = PackOptions {
            variant,
            ..PackOptions::default()
        };
        let (packed, secs) = timed(|| Packed::new(mesh, volume.scalars(), pack_options));
        variants.push((name, packed?, secs));
    }
    drop(volume);
    let Some((_, packed, _)) = variants.last() else {
        unreachable!("two were pushed");
    };
    let size = options.size.of(kind);
    let stage = Stage::new(packed, size)?;
    let rays = stage.rays(packed, options.pixels)?;
    let num_cells = packed.encoded.mesh.num_cells();

    let references: Vec<Built> = {
        let cells = Cells::new(&packed.encoded.mesh, &packed.encoded.map, &packed.field)?;
        let build = |kind: Kind| {
            let is_ospray = matches!(kind, Kind::OsprayOne | Kind::OsprayTwo);
            if options.quick && is_ospray {
                return (
                    kind,
                    Err("a quick run leaves out OSPRay's layouts".to_owned()),
                );
            }
            (kind, build(kind, &cells))
        };
        Kind::ALL.into_iter().map(build).collect()
    };

    let mut peers = Vec::new();
    let mut results = Vec::new();
    for (name, packed, secs) in &variants {
        let bytes = packed.encoded.mesh.bytes();
        let field = packed.field.bytes();
        let parts = [
            ("positions", bytes.positions),
            ("values", field.values),
            ("indices", bytes.indices),
            ("nodes", bytes.nodes),
            ("outer tree", bytes.outer),
            ("headers", bytes.submeshes),
            ("ranges", field.ranges + field.cells_before),
        ];
        peers.push(Some(Peer::packed(&packed.encoded.mesh, &packed.field)));
        let name = format!("packed, variant {name}");
        results.push(peer_result(name, &parts, num_cells, Cell::Value(*secs)));
    }
    for (kind, built) in &references {
        match built {
            Ok((reference, secs)) => {
                peers.push(Some(Peer::Reference(&**reference)));
                let name = kind.name().to_owned();
                let secs = Cell::Value(*secs);
                results.push(peer_result(name, &reference.parts(), num_cells, secs));
            }
            Err(why) => {
                peers.push(None);
                let mut result = peer_result(kind.name().to_owned(), &[], 1, Cell::empty(why));
                result.bytes_per_cell = Cell::empty(why);
                result.picture_secs = Cell::empty(why);
                result.picture_core_secs = Cell::empty(why);
                result.picture_difference = Cell::empty(why);
                result.rates = Order::ALL.map(|order| empty_rate(order, why)).into();
                results.push(result);
            }
        }
    }
    let there: Vec<usize> = (0..peers.len()).filter(|&i| peers[i].is_some()).collect();
    let all: Vec<&Peer> = peers.iter().flatten().collect();
    for order in Order::ALL {
        tracing::info!(order = order.name(), "sampling");
        let (lo, hi) = relative(&stage.bounds, packed);
        let work = match order {
            Order::Rays => Work::Rays(rays.every(EVERY_TILE)),
            Order::Random => Work::Blocks(
                orders::places(lo, hi, options.places, false),
                vacua_pack::Order::Scattered,
            ),
            Order::Morton => Work::Blocks(
                orders::places(lo, hi, options.places, true),
                vacua_pack::Order::Compact,
            ),
        };
        let rates = orders::rates(&all, &work, options.repeats);
        for (&place, (samples_per_sec, samples_per_core_sec)) in there.iter().zip(rates) {
            results[place].rates.push(Rate {
                order,
                samples_per_sec,
                samples_per_core_sec,
            });
        }
    }
    tracing::info!("rendering pictures");
    let pictures = pictures(&all, &rays, &stage.table, options.repeats);
    for (&place, (picture, took)) in there.iter().zip(&pictures) {
        results[place].picture_secs = Cell::Value(took.secs);
        results[place].picture_core_secs = core_secs(took);
        let difference = picture.largest_difference(&pictures[0].0);
        results[place].picture_difference = Cell::Value(difference);
    }
    Ok(SceneResult {
        model,
        size,
        cells: Cell::Value(num_cells),
        samples: rays.num_samples() as u64,
        peers: results,
        frames: frames(&dataset, &stage, options),
    })
}

/// The box of a mesh, relative to its origin.
fn relative(bounds: &Bounds, packed: &Packed) -> ([f64; 3], [f64; 3]) {
    let origin = packed.encoded.mesh.origin();
    let minus = |c: [f64; 3]| [0, 1, 2].map(|i| c[i] - origin[i]);
    (minus(bounds.lo.to_array()), minus(bounds.hi.to_array()))
}

/// What is known of a peer before it is measured.
fn peer_result(
    name: String,
    parts: &[(&str, usize)],
    num_cells: u64,
    build_secs: Cell<f64>,
) -> PeerResult {
    let bytes: usize = parts.iter().map(|part| part.1).sum();
    let parts = parts.iter().map(|&(name, n)| (name.to_owned(), n as u64));
    PeerResult {
        name,
        parts: parts.collect(),
        bytes_per_cell: Cell::Value(bytes as f64 / num_cells as f64),
        build_secs,
        rates: Vec::new(),
        picture_secs: Cell::empty("not rendered"),
        picture_core_secs: Cell::empty("not rendered"),
        picture_difference: Cell::empty("not rendered"),
    }
}

fn empty_rate(order: Order, why: &str) -> Rate {
    Rate {
        order,
        samples_per_sec: Cell::empty(why),
        samples_per_core_sec: Cell::empty(why),
    }
}

/// Pictures of peers that take turns, with what each took.
pub(super) fn pictures(
    peers: &[&Peer],
    rays: &Rays,
    table: &TransferTable,
    repeats: usize,
) -> Vec<(Picture, Took)> {
    let mut all = vec![Vec::new(); peers.len()];
    let mut pictures = Vec::new();
    for repeat in 0..repeats {
        for (peer, took) in peers.iter().zip(&mut all) {
            let (picture, this) = clocked(|| picture::render(peer, rays, table));
            took.push(this);
            if repeat == 0 {
                pictures.push(picture);
            }
        }
    }
    let took = all.iter().map(|took| medians(took));
    pictures.into_iter().zip(took).collect()
}

/// Seconds of a core, if they are known.
pub(super) fn core_secs(took: &Took) -> Cell<f64> {
    took.core_secs.map_or(Cell::empty(NO_CLOCK), Cell::Value)
}

/// Frames of the renderer, with and without skipping.
fn frames(dataset: &Dataset, stage: &Stage, options: &SampleOptions) -> Vec<FrameResult> {
    let methods = [SkipMethod::None, SkipMethod::Auto].into_iter();
    if options.quick {
        let why = "a quick run leaves out frames of the renderer";
        let empty = |method: SkipMethod| FrameResult {
            skip: method.name().to_owned(),
            samples: Cell::empty(why),
            secs: Cell::empty(why),
            core_secs: Cell::empty(why),
        };
        return methods.map(empty).collect();
    }
    let started = || -> Result<(CpuRenderer, RenderScene), BenchError> {
        let volume: Arc<_> = meshes::volume(dataset)?;
        let scene = RenderScene::new(volume, stage.scene.transfer_function.clone())
            .camera(picture::camera(&stage.scene));
        Ok((CpuRenderer::new(options.threads)?, scene))
    };
    let mut started = started().map_err(|e| e.to_string());
    let mut frame = |method: SkipMethod| -> Result<(u64, Took), String> {
        let (renderer, scene) = started.as_mut().map_err(|e| e.clone())?;
        let settings = RenderSettings {
            width: options.pixels,
            height: options.pixels,
            skip: method,
            ..RenderSettings::default()
        };
        let mut render = || renderer.render(scene, &settings).map_err(|e| e.to_string());
        let mut samples = render()?.frame.total_samples();
        let mut all = Vec::new();
        for _ in 0..options.repeats {
            let (rendering, took) = clocked(&mut render);
            samples = rendering?.frame.total_samples();
            all.push(took);
        }
        Ok((samples, medians(&all)))
    };
    methods
        .map(|method| {
            let skip = method.name().to_owned();
            match frame(method) {
                Ok((samples, took)) => FrameResult {
                    skip,
                    samples: Cell::Value(samples),
                    secs: Cell::Value(took.secs),
                    core_secs: core_secs(&took),
                },
                Err(why) => FrameResult {
                    skip,
                    samples: Cell::empty(&why),
                    secs: Cell::empty(&why),
                    core_secs: Cell::empty(&why),
                },
            }
        })
        .collect()
}
