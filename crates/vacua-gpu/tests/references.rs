//! Reference encodings on the device: pictures and samples are those of the packed form to the bit.

mod common;

use std::sync::Arc;

use common::*;
use vacua_gpu::{GpuOptions, GpuRenderer, MeshEncoding, MeshReference, Tracer};
use vacua_pack::reference::{Cells, Reference, UserGeometry};
use vacua_pack::{EncodeOptions, PackedField, PackedVolume, encode};
use vacua_render::{
    Frame, Integrator, Jitter, RenderSettings, Renderer, Scene, Shading, SkipMethod,
};
use vacua_simd::LANES;
use vacua_synth::{MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{ComponentChoice, FieldChoice, ValueScale};

const ALL: [MeshEncoding; 3] = [
    MeshEncoding::UserGeometry,
    MeshEncoding::SharedFaces,
    MeshEncoding::TetMarch,
];

/// A scene of a mesh of some thousand cells, and its cells as they are packed.
fn packed(spec: &MeshSpec) -> (Scene, Arc<Cells>) {
    let dataset = generate_mesh(spec).expect("a mesh");
    let volume = dataset.volume(&FieldChoice::Only, ComponentChoice::Auto);
    let volume = volume.expect("one field");
    let mesh = volume.mesh().expect("a mesh");
    let encoded = encode(mesh, EncodeOptions::default()).expect("it can be packed");
    let (association, scalars) = (volume.association(), volume.scalars());
    let field = PackedField::pack(&encoded.mesh, &encoded.map, "f", association, scalars);
    let field = field.expect("a field");
    let cells = Cells::new(&encoded.mesh, &encoded.map, &field).expect("values of points");
    let whole = scene(Arc::new(volume), look(0.0, 1.0, 1.5, ValueScale::Linear));
    let data = PackedVolume::new(encoded.mesh, field).into();
    (Scene { data, ..whole }, Arc::new(cells))
}

/// Clean; with moved points and holes, in random order; and with flat cells over others besides, through
/// which no ray goes from face to face.
fn specs(kind: MeshKind, size: usize) -> [MeshSpec; 3] {
    let clean = MeshSpec {
        size,
        ..MeshSpec::new(kind)
    };
    let moved = MeshSpec {
        // What is Delaunay has cells flat enough to be turned inside out.
        jitter: if kind == MeshKind::Delaunay {
            0.0
        } else {
            0.15
        },
        holes: 0.1,
        shuffled: true,
        ..clean
    };
    let overlapping = MeshSpec {
        num_slivers: 20,
        ..moved
    };
    [clean, moved, overlapping]
}

/// Whether an encoding holds a mesh.
fn holds(encoding: MeshEncoding, spec: &MeshSpec) -> bool {
    let is_of_tets = matches!(
        spec.kind,
        MeshKind::Tet100 | MeshKind::Jets | MeshKind::Delaunay
    );
    encoding == MeshEncoding::UserGeometry || is_of_tets && spec.num_slivers == 0
}

fn hold(gpu: &mut GpuRenderer, encoding: Option<MeshEncoding>, cells: &Arc<Cells>) {
    gpu.set_reference(encoding.map(|encoding| MeshReference {
        encoding,
        cells: cells.clone(),
    }));
}

fn picture(gpu: &mut GpuRenderer, scene: &Scene, settings: &RenderSettings) -> Frame {
    gpu.render(scene, settings).expect("a good scene").frame
}

fn tracing(options: GpuOptions) -> Option<GpuRenderer> {
    let gpu = renderer(options)?;
    if gpu.device().info().has_ray_tracing() {
        return Some(gpu);
    }
    let is_required = std::env::var_os("VACUA_GPU_REQUIRED").is_some();
    assert!(!is_required, "no device that traces rays");
    eprintln!("SKIPPED: no device that traces rays");
    None
}

fn check_pictures(kind: MeshKind, size: usize) {
    let Some(mut gpu) = tracing(GpuOptions::default()) else {
        return;
    };
    for spec in specs(kind, size) {
        let (scene, cells) = packed(&spec);
        let ways = [SkipMethod::None, SkipMethod::Grid].map(|skip| RenderSettings {
            skip,
            shading: match skip {
                SkipMethod::None => Shading::None,
                _ => Shading::Gradient,
            },
            macrocell_side: Some(2),
            ..settings()
        });
        hold(&mut gpu, None, &cells);
        let expected = ways.each_ref().map(|s| picture(&mut gpu, &scene, s));
        for encoding in ALL.into_iter().filter(|&e| holds(e, &spec)) {
            hold(&mut gpu, Some(encoding), &cells);
            for (settings, expected) in ways.iter().zip(&expected) {
                let found = picture(&mut gpu, &scene, settings);
                let what = format!("{kind}, jitter {}, {}", spec.jitter, encoding.name());
                assert_same_bits(&what, &found, expected);
            }
            let bytes = gpu.mesh_bytes().expect("a mesh");
            assert!(bytes.structures > 0 && bytes.nodes == 0, "{bytes:?}");
            let has_links = encoding != MeshEncoding::UserGeometry;
            assert_eq!(bytes.links > 0, has_links, "{bytes:?}");
        }
    }
    assert_valid(&gpu);
}

#[test]
fn pictures_of_tetrahedra_are_those_of_the_packed_form() {
    check_pictures(MeshKind::Tet100, 8);
    check_pictures(MeshKind::Jets, 7);
}

#[test]
fn pictures_of_a_delaunay_mesh_are_those_of_the_packed_form() {
    check_pictures(MeshKind::Delaunay, 6);
}

#[test]
fn pictures_of_other_cells_are_those_of_the_packed_form() {
    check_pictures(MeshKind::Hex150, 9);
    check_pictures(MeshKind::Lander, 6);
    check_pictures(MeshKind::Octree, 8);
}

#[test]
fn every_setting() {
    let Some(mut gpu) = tracing(GpuOptions::default()) else {
        return;
    };
    let [_, spec, _] = specs(MeshKind::Tet100, 7);
    let (scene, cells) = packed(&spec);
    let with = |change: &dyn Fn(&mut RenderSettings)| {
        let mut settings = settings();
        settings.skip = SkipMethod::None;
        change(&mut settings);
        settings
    };
    let ways = [
        with(&|s| s.integrator = Integrator::MaximumIntensity),
        with(&|s| s.jitter = Jitter::On),
        with(&|s| s.step = 2.0),
        with(&|s| s.step = 0.11),
        with(&|s| s.termination = 0.5),
    ];
    hold(&mut gpu, None, &cells);
    let expected = ways.each_ref().map(|s| picture(&mut gpu, &scene, s));
    for encoding in ALL {
        hold(&mut gpu, Some(encoding), &cells);
        for (i, (settings, expected)) in ways.iter().zip(&expected).enumerate() {
            let found = picture(&mut gpu, &scene, settings);
            assert_same_bits(&format!("{}, way {i}", encoding.name()), &found, expected);
        }
    }
    assert_valid(&gpu);
}

/// Places anywhere, on points and between them: cells are those of the CPU's encoding, values those of
/// the packed form on the device.
#[test]
fn samples_are_those_of_the_packed_form() {
    let Some(mut gpu) = tracing(GpuOptions::default()) else {
        return;
    };
    for kind in [MeshKind::Tet100, MeshKind::Delaunay, MeshKind::Lander] {
        for mut spec in specs(kind, 6) {
            // Cells that have but a point in common do not know of each other.
            spec.holes = 0.0;
            let (scene, cells) = packed(&spec);
            let vertices = cells.vertices();
            let mut state = 1u32;
            let mut next = move || {
                state = state.wrapping_mul(1664525).wrapping_add(1013904223);
                (state >> 8) as usize
            };
            let places: Vec<[f32; 3]> = (0..2000)
                .map(|_| {
                    let (p, q) = (next() % vertices.len(), next() % vertices.len());
                    let t = [0.0, 0.5, 0.25, 0.3][next() % 4];
                    let (p, q) = (vertices[p], vertices[q]);
                    [0, 1, 2].map(|a| p[a] + t * (q[a] - p[a]))
                })
                .collect();
            let tiny = RenderSettings {
                width: 8,
                height: 8,
                ..settings()
            };
            hold(&mut gpu, None, &cells);
            picture(&mut gpu, &scene, &tiny);
            let expected = gpu.sample_mesh(&places).expect("a device");
            let on_cpu = UserGeometry::new(&cells);
            for encoding in ALL.into_iter().filter(|&e| holds(e, &spec)) {
                hold(&mut gpu, Some(encoding), &cells);
                picture(&mut gpu, &scene, &tiny);
                let found = gpu.sample_mesh(&places).expect("a device");
                let blocks = places.chunks(LANES).zip(found.chunks(LANES));
                let mut seen = 0;
                for (places, found) in blocks {
                    let mut at = [[0.0; LANES]; 3];
                    for (lane, place) in places.iter().enumerate() {
                        (0..3).for_each(|a| at[a][lane] = place[a]);
                    }
                    let lanes = ((1u32 << places.len()) - 1) as u16;
                    let theirs = on_cpu.sample(&at, lanes);
                    for (lane, ours) in found.iter().enumerate() {
                        let is_there = theirs.valid >> lane & 1 == 1;
                        let cell = is_there.then_some((0, theirs.cells[lane]));
                        assert_eq!(ours.cell, cell, "{kind} {encoding:?} at {:?}", places[lane]);
                        seen += usize::from(is_there);
                    }
                }
                assert!(seen > places.len() / 2, "{kind}: {seen} places in cells");
                for (i, (ours, theirs)) in found.iter().zip(&expected).enumerate() {
                    let bits = |v: Option<f32>| v.map(f32::to_bits);
                    let same = bits(ours.value) == bits(theirs.value);
                    assert!(same, "{kind} {encoding:?} at {:?}", places[i]);
                }
            }
        }
    }
    assert_valid(&gpu);
}

/// User geometry by ray queries, where there are any.
#[test]
fn ray_queries_find_cells_of_lists_too() {
    let options = GpuOptions {
        tracer: Some(Tracer::Query),
        ..GpuOptions::default()
    };
    let Some(mut gpu) = renderer(options) else {
        return;
    };
    if !gpu.device().info().has_ray_queries() {
        return;
    }
    let [_, spec, _] = specs(MeshKind::Lander, 6);
    let (scene, cells) = packed(&spec);
    hold(&mut gpu, None, &cells);
    let expected = picture(&mut gpu, &scene, &settings());
    hold(&mut gpu, Some(MeshEncoding::UserGeometry), &cells);
    let found = picture(&mut gpu, &scene, &settings());
    assert_same_bits("by ray queries", &found, &expected);
    assert_valid(&gpu);
}

#[test]
fn what_an_encoding_cannot_hold_is_said() {
    let Some(mut gpu) = tracing(GpuOptions::default()) else {
        return;
    };
    let [hexahedra, ..] = specs(MeshKind::Hex150, 4);
    let (scene, cells) = packed(&hexahedra);
    hold(&mut gpu, Some(MeshEncoding::TetMarch), &cells);
    let refused = gpu.render(&scene, &settings()).err();
    let message = refused.map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("tetrahedra only"), "{message}");
    let [other, ..] = specs(MeshKind::Hex150, 5);
    let (_, others) = packed(&other);
    hold(&mut gpu, Some(MeshEncoding::UserGeometry), &others);
    let refused = gpu.render(&scene, &settings()).err();
    let message = refused.map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("the packed mesh has"), "{message}");
    hold(&mut gpu, None, &others);
    gpu.render(&scene, &settings()).expect("it still renders");
}
