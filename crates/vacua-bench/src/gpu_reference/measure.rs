//! Measures meshes on a device, way by way.

use std::sync::Arc;
use std::time::{Duration, Instant};

use vacua_gpu::{GpuRenderer, MeshEncoding, MeshReference};
use vacua_pack::reference::Cells;
use vacua_pack::{EncodeOptions, PackedVolume, Variant};
use vacua_render::{Frame, RenderSettings, Renderer, Scene, SkipMethod};
use vacua_synth::BenchScene;
use vacua_volume::{Bounds, Dataset, UnstructuredMesh};

use super::{DevicePeer, GpuReferenceOptions, ReferenceMesh};
use crate::cell::Cell;
use crate::error::BenchError;
use crate::gpu_mesh::{MeshChoice, parts, random_places, rate, view_of};
use crate::meshes::{self, MeshSize, Packed};
use crate::sample::parts::cut;
use crate::sample::{Share, SharePeer, ShareResult};
use crate::timing::median;

/// The encodings of Tables 4 and 6, in the order of their columns.
const ENCODINGS: [MeshEncoding; 3] = [
    MeshEncoding::UserGeometry,
    MeshEncoding::SharedFaces,
    MeshEncoding::TetMarch,
];

/// Time for which a device renders before it is measured.
const WARM_UP: Duration = Duration::from_millis(500);

/// Everything about one mesh.
pub(super) fn mesh(
    gpu: &mut GpuRenderer,
    options: &GpuReferenceOptions,
    choice: MeshChoice,
) -> ReferenceMesh {
    let measured = made(options, choice)
        .and_then(|dataset| all_ways(gpu, options, choice, &dataset))
        .map_err(|e| e.to_string());
    measured.unwrap_or_else(|why| ReferenceMesh {
        model: meshes::Scene(choice.kind),
        size: choice.size,
        cells: Cell::empty(why),
        samples: 0,
        peers: Vec::new(),
    })
}

/// All shares, of the first mesh.
pub(super) fn shares(gpu: &mut GpuRenderer, options: &GpuReferenceOptions) -> Vec<ShareResult> {
    let Some(&choice) = options.meshes.first() else {
        return Vec::new();
    };
    if options.shares.is_empty() {
        return Vec::new();
    }
    let made = made(options, choice).map_err(|e| e.to_string());
    let of_share = |&of: &Share| {
        tracing::info!(part = of.part, of = of.of, "measuring a share");
        let measured = match &made {
            Ok(dataset) => share(gpu, options, choice, dataset, of).map_err(|e| e.to_string()),
            Err(why) => Err(why.clone()),
        };
        measured.unwrap_or_else(|why| ShareResult {
            share: of,
            cells: Cell::empty(why),
            peers: Vec::new(),
        })
    };
    options.shares.iter().map(of_share).collect()
}

fn made(options: &GpuReferenceOptions, choice: MeshChoice) -> Result<Dataset, BenchError> {
    let size = MeshSize {
        scale: 1.0,
        cells: Some(choice.size),
        shuffled: options.shuffled,
    };
    size.make(choice.kind)
}

/// A packed mesh in its scene, and its cells.
struct Subject {
    scene: Scene,
    cells: Option<Arc<Cells>>,
    num_cells: u64,
    num_submeshes: u64,
    num_nodes: u64,
}

impl Subject {
    fn new(
        mesh: &UnstructuredMesh,
        dataset: &Dataset,
        choice: MeshChoice,
        variant: Variant,
    ) -> Result<Self, BenchError> {
        let volume = meshes::volume(dataset)?;
        let bounds: Bounds = volume.geometry().bounds();
        let packing = EncodeOptions {
            variant,
            ..EncodeOptions::default()
        };
        let Packed { encoded, field } = Packed::new(mesh, volume.scalars(), packing)?;
        let cells = match variant {
            Variant::MultiNodes => Some(Cells::new(&encoded.mesh, &encoded.map, &field)?),
            _ => None,
        };
        let look = BenchScene::transfer_function(1.0)?;
        Ok(Self {
            cells: cells.map(Arc::new),
            num_cells: encoded.mesh.num_cells(),
            num_submeshes: encoded.mesh.submeshes().len() as u64,
            num_nodes: encoded.mesh.nodes().len() as u64,
            scene: Scene::new(PackedVolume::new(encoded.mesh, field), look)
                .camera(view_of(choice, bounds)),
        })
    }
}

/// What a way to hold a mesh gave: the first picture, to compare others with.
struct Measured {
    peer: DevicePeer,
    frame: Option<Frame>,
}

/// Measures one way to hold a mesh, whose pictures should be those of `base`.
fn measure(
    gpu: &mut GpuRenderer,
    options: &GpuReferenceOptions,
    subject: &Subject,
    encoding: Option<MeshEncoding>,
    base: Option<&Frame>,
) -> Measured {
    let name = encoding.map_or("packed", MeshEncoding::name).to_owned();
    tracing::info!(name, "measuring a way to hold a mesh");
    let found = picture(gpu, options, subject, encoding);
    match found {
        Ok((mut peer, frame)) => {
            peer.name = name;
            compare(&mut peer, &frame, base.unwrap_or(&frame));
            let frame = Some(frame);
            Measured { peer, frame }
        }
        Err(why) => Measured {
            peer: empty(name, &why.to_string()),
            frame: None,
        },
    }
}

fn empty(name: String, why: &str) -> DevicePeer {
    DevicePeer {
        name,
        nodes: None,
        submeshes: None,
        file_bytes: None,
        parts: Vec::new(),
        bytes: Cell::empty(why),
        send_secs: Cell::empty(why),
        march_secs: Cell::empty(why),
        rays_per_sec: Cell::empty(why),
        random_per_sec: Cell::empty(why),
        num_different: Cell::empty(why),
        difference: Cell::empty(why),
    }
}

fn picture(
    gpu: &mut GpuRenderer,
    options: &GpuReferenceOptions,
    subject: &Subject,
    encoding: Option<MeshEncoding>,
) -> Result<(DevicePeer, Frame), BenchError> {
    let cells = subject.cells.clone();
    gpu.set_reference(
        encoding
            .zip(cells)
            .map(|(encoding, cells)| MeshReference { encoding, cells }),
    );
    let settings = RenderSettings {
        width: options.size.0,
        height: options.size.1,
        skip: SkipMethod::None,
        ..RenderSettings::default()
    };
    let frame = gpu.render(&subject.scene, &settings)?.frame;
    // A device that rests slows its clock down, and takes a while to come back: what is measured first
    // must not pay for that.
    let start = Instant::now();
    while start.elapsed() < WARM_UP {
        gpu.time_rays(&subject.scene, &settings, 1)?;
    }
    let timings = gpu.time_rays(&subject.scene, &settings, options.repeats.max(1))?;
    let march_secs = median(timings.iter().map(|t| t.secs("march")).collect());
    let bytes = gpu.mesh_bytes().unwrap_or_default();
    let is_packed = encoding.is_none();
    let random_per_sec = match options.places {
        0 => Cell::empty("no places were asked for"),
        count => {
            let places = random_places(gpu, count);
            match rate(gpu, &places) {
                Ok(rate) => Cell::Value(rate),
                Err(why) => Cell::empty(why.to_string()),
            }
        }
    };
    let peer = DevicePeer {
        name: String::new(),
        nodes: is_packed.then_some(subject.num_nodes),
        submeshes: is_packed.then_some(subject.num_submeshes),
        file_bytes: gpu.mesh_file_bytes().filter(|_| is_packed),
        parts: parts(bytes).map(|(name, n)| (name.to_owned(), n)).into(),
        bytes: Cell::Value(bytes.total()),
        send_secs: Cell::Value(gpu.mesh_send_secs()),
        march_secs: Cell::Value(march_secs),
        rays_per_sec: Cell::Value(frame.total_samples() as f64 / march_secs),
        random_per_sec,
        num_different: Cell::Value(0),
        difference: Cell::Value(0.0),
    };
    Ok((peer, frame))
}

/// Counts what is different from a picture.
fn compare(peer: &mut DevicePeer, frame: &Frame, base: &Frame) {
    let pairs = || frame.rgba.iter().zip(&base.rgba);
    let depths = frame.depth.iter().zip(&base.depth);
    let different = pairs()
        .zip(depths)
        .filter(|((a, b), (c, d))| a != b || c != d);
    peer.num_different = Cell::Value(different.count() as u64);
    let apart = pairs().flat_map(|(a, b)| [0, 1, 2, 3].map(|i| f64::from((a[i] - b[i]).abs())));
    peer.difference = Cell::Value(apart.fold(0.0, f64::max));
}

fn all_ways(
    gpu: &mut GpuRenderer,
    options: &GpuReferenceOptions,
    choice: MeshChoice,
    dataset: &Dataset,
) -> Result<ReferenceMesh, BenchError> {
    let mesh = meshes::mesh(dataset)?;
    let subject = Subject::new(mesh, dataset, choice, Variant::MultiNodes)?;
    let Measured { mut peer, frame } = measure(gpu, options, &subject, None, None);
    peer.name = "packed, variant 2".to_owned();
    let base = frame.as_ref();
    let samples = base.map_or(0, Frame::total_samples);
    let mut peers = vec![peer];
    {
        let leaves = Subject::new(mesh, dataset, choice, Variant::MultiLeaves)?;
        let mut peer = measure(gpu, options, &leaves, None, base).peer;
        peer.name = "packed, variant 1".to_owned();
        peers.push(peer);
    }
    for encoding in ENCODINGS {
        peers.push(measure(gpu, options, &subject, Some(encoding), base).peer);
    }
    gpu.set_reference(None);
    Ok(ReferenceMesh {
        model: meshes::Scene(choice.kind),
        size: choice.size,
        cells: Cell::Value(subject.num_cells),
        samples,
        peers,
    })
}

fn share(
    gpu: &mut GpuRenderer,
    options: &GpuReferenceOptions,
    choice: MeshChoice,
    dataset: &Dataset,
    share: Share,
) -> Result<ShareResult, BenchError> {
    let mesh = cut(meshes::mesh(dataset)?, share)?;
    let subject = Subject::new(&mesh, dataset, choice, Variant::MultiNodes)?;
    drop(mesh);
    let options = GpuReferenceOptions {
        places: 0,
        ..options.clone()
    };
    let packed = measure(gpu, &options, &subject, None, None);
    let packed_bytes = packed.peer.bytes.value();
    let mut peers = vec![packed.peer];
    for encoding in ENCODINGS {
        peers.push(
            measure(
                gpu,
                &options,
                &subject,
                Some(encoding),
                packed.frame.as_ref(),
            )
            .peer,
        );
    }
    gpu.set_reference(None);
    let peers = peers.into_iter().map(|peer| SharePeer {
        ratio: match packed_bytes {
            Some(packed) => peer.bytes.map(|n| n as f64 / packed as f64),
            None => Cell::empty("the packed form was not measured"),
        },
        name: peer.name,
        bytes: peer.bytes,
        secs: peer.march_secs,
        core_secs: Cell::empty("on a GPU"),
    });
    Ok(ShareResult {
        share,
        cells: Cell::Value(subject.num_cells),
        peers: peers.collect(),
    })
}
