//! Packed meshes on the device: cells and values at places against the CPU's, pictures against the
//! CPU's and against those without skipping.

mod common;

use std::sync::Arc;

use common::*;
use glam::DVec3;
use vacua_gpu::{GpuOptions, GpuRenderer, MeshSample, Search, Tracer};
use vacua_io::Source;
use vacua_pack::block::Places;
use vacua_pack::file::{PackedFile, seal, write_file};
use vacua_pack::layout::{Child, MultiNode};
use vacua_pack::{
    BlockSampler, DetailLevel, EncodeOptions, Nodes, PackedField, PackedVolume, Variant, encode,
};
use vacua_render::contract::PackedCells;
use vacua_render::{
    Camera, ClipPlane, Detail, Frame, Integrator, Jitter, Projection, RenderSettings, Renderer,
    Scene, Shading, SkipMethod,
};
use vacua_simd::LANES;
use vacua_synth::{MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{
    Association, Bounds, ComponentChoice, DataArray, Dataset, Field, FieldChoice, Geometry, Scalar,
    UnstructuredMesh, ValueScale, Volume,
};

/// A mesh of some thousand cells.
fn small(kind: MeshKind) -> MeshSpec {
    let size = match kind {
        MeshKind::Tet100 => 9,
        MeshKind::Hex150 => 12,
        MeshKind::Jets => 8,
        MeshKind::Delaunay => 7,
        MeshKind::Lander => 8,
        MeshKind::Ocean => 12,
        MeshKind::Octree => 10,
    };
    MeshSpec {
        size,
        ..MeshSpec::new(kind)
    }
}

fn volume_of(dataset: &Dataset) -> Arc<Volume> {
    let volume = dataset.volume(&FieldChoice::Only, ComponentChoice::Auto);
    Arc::new(volume.expect("one field"))
}

/// A mesh with other values than its own; `to` turns the number of a point or cell, and the value of
/// its first point, into one that is stored.
fn with_values<T: Scalar>(
    spec: &MeshSpec,
    association: Association,
    to: impl Fn(usize, f64) -> T,
) -> Arc<Volume> {
    let dataset = generate_mesh(spec).expect("a mesh");
    let values = dataset.fields()[0].load().expect("values").clone();
    let count = match association {
        Association::Point => values.tuples(),
        Association::Cell => dataset.mesh().expect("a mesh").num_cells() as usize,
    };
    let stored: Vec<T> = (0..count)
        .map(|i| to(i, values.get_f64(i % values.tuples(), 0)))
        .collect();
    let array = DataArray::from_vec(stored, 1).expect("one component");
    let field = Field::new("f", association, array);
    let dataset = Dataset::new((**dataset.geometry()).clone(), vec![field]).expect("it fits");
    volume_of(&dataset)
}

/// Numbers below 1, the same every time.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Places everywhere in a mesh and a little around it, on its points, edges and faces.
fn places(cells: &PackedCells, count: usize) -> Vec<[f32; 3]> {
    let mesh = cells.mesh();
    let headers = mesh.submeshes();
    let mut random = Random(7);
    let lo = [0, 1, 2].map(|a| {
        headers
            .iter()
            .map(|h| h.lo[a])
            .fold(f32::INFINITY, f32::min)
    });
    let hi = [0, 1, 2].map(|a| {
        headers
            .iter()
            .map(|h| h.hi[a])
            .fold(f32::NEG_INFINITY, f32::max)
    });
    let mut found: Vec<[f32; 3]> = (0..count)
        .map(|_| [0, 1, 2].map(|a| lo[a] + (hi[a] - lo[a]) * (1.1 * random.next() - 0.05) as f32))
        .collect();
    let positions = mesh.positions();
    for _ in 0..count / 2 {
        let i = (random.next() * positions.len() as f64) as usize % positions.len();
        let j = (i + 1) % positions.len();
        let t = [0.0, 0.5, 1.0, 0.3][(random.next() * 4.0) as usize % 4];
        let (p, q) = (positions[i], positions[j]);
        found.push([0, 1, 2].map(|a| p[a] + t * (q[a] - p[a])));
    }
    // Neighbours next to each other, as rays are.
    let key = |place: &[f32; 3]| {
        let at = [0, 1, 2].map(|a| (24.0 * (place[a] - lo[a]) / (hi[a] - lo[a])) as i32 + 2);
        let bit = |a: usize, i: u32| (at[a] >> i & 1) << (3 * i + a as u32);
        (0..5)
            .map(|i| bit(0, i) | bit(1, i) | bit(2, i))
            .sum::<i32>()
    };
    found.sort_by_key(key);
    found
}

/// What the CPU says of places.
fn on_cpu_at(cells: &PackedCells, places: &[[f32; 3]]) -> Vec<MeshSample> {
    let sampler = BlockSampler::new(cells.mesh(), cells.field(), None);
    let mut all = Vec::new();
    for block in places.chunks(LANES) {
        let mut at: Places = [[0.0; LANES]; 3];
        for (lane, place) in block.iter().enumerate() {
            for a in 0..3 {
                at[a][lane] = place[a];
            }
        }
        let sampled = sampler.sample(&at, ((1u32 << block.len()) - 1) as u16);
        for lane in 0..block.len() {
            let is = |bits: u16| bits >> lane & 1 == 1;
            let located = &sampled.located;
            all.push(MeshSample {
                cell: is(located.found)
                    .then(|| (located.submesh[lane], located.primitive[lane] as u32)),
                value: is(sampled.valid).then_some(sampled.values[lane]),
            });
        }
    }
    all
}

/// Compares cells and values at many places, searched for together and alone.
fn check_samples(what: &str, volume: Arc<Volume>, options: GpuOptions) {
    let Some(mut gpu) = renderer(options) else {
        return;
    };
    let cells = PackedCells::of_data(&volume.clone().into()).expect("it can be packed");
    let cells = cells.expect("a mesh");
    let places = places(&cells, 3000);
    // Values are differences of those at corners: what rounding takes is a part of the largest.
    let range = volume.scalars().range(0).expect("values");
    let unit = range.lo.abs().max(range.hi.abs()) as f32 * f32::EPSILON;
    let expected = on_cpu_at(&cells, &places);
    let tiny = RenderSettings {
        width: 8,
        height: 8,
        ..settings()
    };
    gpu.render(
        &scene(volume, look(0.0, 1.0, 1.0, ValueScale::Linear)),
        &tiny,
    )
    .expect("a good scene");
    let found = expected.iter().filter(|s| s.cell.is_some()).count();
    assert!(found > places.len() / 4, "{what}: {found} places in cells");
    for search in [Search::Together, Search::Alone] {
        gpu.set_places_search(search);
        let samples = gpu.sample_mesh(&places).expect("a device");
        let mut worst = 0.0f32;
        let mut others = 0;
        for (i, (ours, theirs)) in samples.iter().zip(&expected).enumerate() {
            if ours.cell != theirs.cell {
                others += 1;
                if others < 5 {
                    eprintln!(
                        "{what} {search:?}: {:?}: {ours:?}, not {theirs:?}",
                        places[i]
                    );
                }
                continue;
            }
            match (ours.value, theirs.value) {
                (Some(a), Some(b)) => worst = worst.max((a - b).abs() / unit),
                (a, b) => assert_eq!(a, b, "{what}: value at {:?}", places[i]),
            }
        }
        eprintln!(
            "{what}, {search:?}: {found} of {} in cells, values {worst} ulp",
            places.len()
        );
        assert_eq!(others, 0, "{what}: places in other cells");
        assert!(
            worst <= 8.0,
            "{what}: {worst} units in the last place of the largest value"
        );
    }
    assert_valid(&gpu);
}

#[test]
fn cells_and_values_of_every_kind_are_those_of_the_cpu() {
    for kind in MeshKind::ALL {
        let spec = small(kind);
        let dataset = generate_mesh(&spec).expect("a mesh");
        check_samples(kind.name(), volume_of(&dataset), GpuOptions::default());
        let spec = MeshSpec {
            jitter: 0.2,
            holes: 0.05,
            num_slivers: 40,
            shuffled: true,
            ..spec
        };
        let dataset = generate_mesh(&spec).expect("a mesh");
        let what = format!("{kind}, disturbed");
        check_samples(&what, volume_of(&dataset), GpuOptions::default());
    }
}

#[test]
fn values_of_every_type_and_association() {
    for kind in [MeshKind::Tet100, MeshKind::Octree] {
        let spec = small(kind);
        for of in [Association::Point, Association::Cell] {
            let check = |what: &str, volume| {
                check_samples(
                    &format!("{kind} {what} {of}s"),
                    volume,
                    GpuOptions::default(),
                );
            };
            check("u8", with_values(&spec, of, |i, _| (i % 251) as u8));
            check("i8", with_values(&spec, of, |i, _| (i % 251) as u8 as i8));
            check(
                "u16",
                with_values(&spec, of, |i, _| (i * 977 % 65521) as u16),
            );
            check(
                "i16",
                with_values(&spec, of, |i, _| (i * 977 % 65521) as u16 as i16),
            );
            check(
                "f32",
                with_values(
                    &spec,
                    of,
                    |i, v| {
                        if i % 17 == 0 { f32::NAN } else { v as f32 }
                    },
                ),
            );
        }
    }
}

#[test]
fn parts_in_many_buffers() {
    let options = GpuOptions {
        max_buffer_bytes: Some(1 << 16),
        ..GpuOptions::default()
    };
    let spec = MeshSpec {
        size: 26,
        ..MeshSpec::new(MeshKind::Hex150)
    };
    let dataset = generate_mesh(&spec).expect("a mesh");
    check_samples("many buffers", volume_of(&dataset), options);
}

fn scene_of(spec: &MeshSpec) -> Scene {
    let dataset = generate_mesh(spec).expect("a mesh");
    scene(volume_of(&dataset), look(0.0, 1.0, 1.5, ValueScale::Linear))
}

/// Renders with and without skipping, together and alone; all four must be the same to the bit, and
/// like the CPU's.
fn check(what: &str, scene: &Scene, settings: &RenderSettings) {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let picture = |gpu: &mut GpuRenderer, skip, search| -> Frame {
        let settings = RenderSettings {
            skip,
            ..settings.clone()
        };
        gpu.set_search(search);
        gpu.render(scene, &settings).expect("a good scene").frame
    };
    let with = picture(&mut gpu, SkipMethod::Grid, Search::Together);
    let without = picture(&mut gpu, SkipMethod::None, Search::Together);
    assert_same_bits(&format!("{what}, skipping"), &with, &without);
    let alone = picture(&mut gpu, SkipMethod::Grid, Search::Alone);
    assert_same_bits(&format!("{what}, alone"), &with, &alone);
    assert!(
        with.total_samples() <= without.total_samples(),
        "{what}: skipping adds nothing"
    );
    assert_alike(what, &with, &on_cpu(scene, settings));
    assert_valid(&gpu);
}

fn mesh_settings() -> RenderSettings {
    RenderSettings {
        macrocell_side: Some(2),
        ..settings()
    }
}

#[test]
fn pictures_of_every_kind() {
    for kind in MeshKind::ALL {
        check(kind.name(), &scene_of(&small(kind)), &mesh_settings());
        let disturbed = MeshSpec {
            jitter: 0.15,
            holes: 0.1,
            num_slivers: 20,
            shuffled: true,
            ..small(kind)
        };
        let shaded = RenderSettings {
            shading: Shading::Gradient,
            ..mesh_settings()
        };
        check(
            &format!("{kind}, disturbed, shaded"),
            &scene_of(&disturbed),
            &shaded,
        );
    }
}

#[test]
fn every_setting() {
    let scene = scene_of(&small(MeshKind::Octree));
    let with = |change: &dyn Fn(&mut RenderSettings)| {
        let mut settings = mesh_settings();
        change(&mut settings);
        settings
    };
    let all = [
        (
            "maximum",
            with(&|s| s.integrator = Integrator::MaximumIntensity),
        ),
        ("jitter", with(&|s| s.jitter = Jitter::On)),
        (
            "three frames",
            with(&|s| (s.samples_per_pixel, s.first_frame) = (3, 2)),
        ),
        ("K 1", with(&|s| s.macrocell_side = Some(1))),
        ("K 5", with(&|s| s.macrocell_side = Some(5))),
        ("long steps", with(&|s| s.step = 2.0)),
        ("short steps", with(&|s| s.step = 0.11)),
        ("early", with(&|s| s.termination = 0.5)),
        ("never", with(&|s| s.termination = 0.0)),
        ("odd size", with(&|s| (s.width, s.height) = (37, 61))),
    ];
    for (what, settings) in all {
        check(what, &scene, &settings);
    }
}

#[test]
fn every_view_and_cut() {
    let at = DVec3::splat(5.0);
    let placed = |eye, projection| Camera::Placed {
        eye,
        at,
        up: DVec3::Y,
        projection,
    };
    let narrow = Projection::Perspective { fov_degrees: 40.0 };
    let scene = scene_of(&small(MeshKind::Octree));
    let views = [
        ("inside", placed(DVec3::new(2.0, 4.0, 7.0), narrow)),
        ("along x", placed(DVec3::new(-20.0, 5.0, 5.0), narrow)),
        (
            "parallel",
            placed(
                DVec3::new(20.0, 15.0, 30.0),
                Projection::Orthographic { height: 14.0 },
            ),
        ),
        (
            "from afar",
            placed(
                DVec3::new(3e5, 2e5, 4e5),
                Projection::Perspective { fov_degrees: 2e-3 },
            ),
        ),
    ];
    for (what, camera) in views {
        check(what, &scene.clone().camera(camera), &mesh_settings());
    }
    let plane = ClipPlane {
        point: at,
        normal: DVec3::new(1.0, 0.5, -2.0),
    };
    let region = Bounds {
        lo: DVec3::new(1.0, 0.0, 2.0),
        hi: DVec3::new(9.0, 8.0, 7.5),
    };
    let cut = scene.clip(plane).region_of_interest(region);
    check("clip and region", &cut, &mesh_settings());
}

#[test]
fn pictures_of_cell_data_and_other_types() {
    let spec = small(MeshKind::Octree);
    let cells = with_values(&spec, Association::Cell, |_, v| v as f32);
    let look_at = |volume, lo, hi| scene(volume, look(lo, hi, 1.5, ValueScale::Linear));
    check("cell data", &look_at(cells, 0.0, 1.0), &mesh_settings());
    let bytes = with_values(&spec, Association::Point, |_, v| (200.0 * v) as u8);
    check("bytes", &look_at(bytes, 0.0, 200.0), &mesh_settings());
    let wide = with_values(&spec, Association::Point, |_, v| 1e9 + v);
    check("wide", &look_at(wide, 1e9, 1e9 + 1.0), &mesh_settings());
}

/// The same mesh in other units and far from the origin gives a picture as good.
#[test]
fn scales_and_offsets() {
    for kind in [MeshKind::Tet100, MeshKind::Hex150] {
        for (scale, offset) in [(1e-9, 0.0), (1e9, 0.0), (1.0, 1e4)] {
            let dataset = generate_mesh(&small(kind)).expect("a mesh");
            let mesh = dataset.mesh().expect("a mesh");
            let moved: Vec<f64> = (0..mesh.num_points())
                .flat_map(|i| (mesh.position(i) * scale + offset).to_array())
                .collect();
            let moved = UnstructuredMesh::uniform(
                DataArray::from_vec(moved, 3).expect("positions"),
                mesh.uniform_type().expect("one type"),
                mesh.connectivity().clone(),
            );
            let values = dataset.fields()[0].load().expect("values").clone();
            let field = Field::new("f", Association::Point, values);
            let geometry = Geometry::Unstructured(moved.expect("a mesh"));
            let dataset = Dataset::new(geometry, vec![field]).expect("it fits");
            let look = look(0.0, 1.0, 1.5 * scale, ValueScale::Linear);
            let what = format!("{kind}, scale {scale}, offset {offset}");
            check(&what, &scene(volume_of(&dataset), look), &mesh_settings());
        }
    }
}

/// A file, checksums right, in which a node is the child of two others: whoever goes down both ways
/// may do so at every level, and never comes to an end.
#[test]
fn children_of_two_nodes_are_refused() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let spec = MeshSpec {
        size: 16,
        ..MeshSpec::new(MeshKind::Tet100)
    };
    let volume = volume_of(&generate_mesh(&spec).expect("a mesh"));
    let cells = PackedCells::of_data(&volume.into()).expect("it can be packed");
    let cells = cells.expect("a mesh");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh.vacua");
    write_file(&path, cells.mesh(), std::slice::from_ref(cells.field())).expect("room");
    let mut bytes = std::fs::read(&path).expect("it was written");
    let open = |bytes: &[u8]| {
        let file = PackedFile::from_source(Source::from_bytes(&path, bytes.to_vec()));
        PackedVolume::open(&file.expect("right checksums"), &FieldChoice::Only)
    };
    let look = look(0.0, 1.0, 1.5, ValueScale::Linear);
    let tiny = RenderSettings {
        width: 8,
        height: 8,
        ..settings()
    };
    let whole = Scene::new(Arc::new(open(&bytes).expect("a mesh")), look.clone());
    gpu.render(&whole, &tiny).expect("a sound mesh");
    let Nodes::MultiNodes(nodes) = cells.mesh().nodes() else {
        panic!("variant 2 has inner nodes");
    };
    let all = cells.mesh().nodes().bytes();
    let at = bytes.windows(all.len()).position(|w| w == all);
    let at = at.expect("nodes lie in the file as in memory");
    let nodes = nodes.as_slice();
    let children = |n: &MultiNode| {
        let of_node = (0..8).map(|c| n.leaf.child(c));
        of_node.filter(|c| matches!(c, Child::Inner)).count()
    };
    let inner: Vec<usize> = (0..nodes.len())
        .filter(|&n| children(&nodes[n]) > 0)
        .collect();
    // A node gets the children of a later one, which has as many at least.
    let pairs = inner
        .iter()
        .flat_map(|&a| inner.iter().map(move |&b| (a, b)));
    let mut pairs = pairs.filter(|&(a, b)| a < b && children(&nodes[a]) <= children(&nodes[b]));
    let (first, later) = pairs.next().expect("a tree of some levels");
    let size = size_of::<MultiNode>();
    let child = nodes[later].first_child.to_le_bytes();
    let place = at + first * size + size - 4;
    bytes[place..place + 4].copy_from_slice(&child);
    seal(&mut bytes);
    let Ok(hostile) = open(&bytes) else {
        panic!("only the device looks at nodes");
    };
    let refused = gpu.render(&Scene::new(Arc::new(hostile), look), &tiny);
    let message = refused.err().map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("damaged"), "{message}");
    gpu.render(&whole, &tiny).expect("it still renders");
    assert_valid(&gpu);
}

/// Estimates are the CPU's: a device that samples exactly says so, and goes on.
#[test]
fn levels_of_detail_are_refused() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    let scene = scene_of(&small(MeshKind::Tet100));
    let coarse = RenderSettings {
        detail: Detail::Level(DetailLevel::ALL[0]),
        ..mesh_settings()
    };
    let refused = gpu.render(&scene, &coarse).err();
    let message = refused.map(|e| e.to_string()).unwrap_or_default();
    assert!(message.contains("level of detail"), "{message}");
    gpu.render(&scene, &mesh_settings()).expect("exactly");
    assert_valid(&gpu);
}

/// The volume's mesh and field encoded as `variant`.
fn packed(volume: &Volume, variant: Variant) -> PackedVolume {
    let options = EncodeOptions {
        variant,
        ..EncodeOptions::default()
    };
    let mesh = volume.mesh().expect("a mesh");
    let encoded = encode(mesh, options).expect("it can be packed");
    let association = volume.association();
    let scalars = volume.scalars();
    let field = PackedField::pack(&encoded.mesh, &encoded.map, "f", association, scalars);
    PackedVolume::new(encoded.mesh, field.expect("a field"))
}

/// Only the CPU decodes variant small; a device says so before it reads anything.
#[test]
fn variant_small_is_refused() {
    let Some(mut gpu) = renderer(GpuOptions::default()) else {
        return;
    };
    for kind in [MeshKind::Tet100, MeshKind::Octree] {
        let volume = volume_of(&generate_mesh(&small(kind)).expect("a mesh"));
        let small = packed(&volume, Variant::Small);
        let scene = Scene {
            data: small.into(),
            ..scene(volume, look(0.0, 1.0, 1.5, ValueScale::Linear))
        };
        let refusal = gpu.render(&scene, &mesh_settings()).err();
        let message = refusal.map(|error| error.to_string()).unwrap_or_default();
        assert!(message.contains("variant small"), "{kind:?}: {message}");
    }
    assert_valid(&gpu);
}

/// Variant 1: multi-leaves under an acceleration structure, by ray queries and on a pipeline.
#[test]
fn multi_leaves_are_found_by_rays_of_no_length() {
    for kind in [MeshKind::Tet100, MeshKind::Octree] {
        let spec = MeshSpec {
            jitter: 0.15,
            holes: 0.1,
            shuffled: true,
            ..small(kind)
        };
        let volume = volume_of(&generate_mesh(&spec).expect("a mesh"));
        let packed = packed(&volume, Variant::MultiLeaves);
        let whole = scene(volume, look(0.0, 1.0, 1.5, ValueScale::Linear));
        let leaves = Scene {
            data: packed.into(),
            ..whole.clone()
        };
        let expected = on_cpu(&leaves, &mesh_settings());
        let mut pictures = Vec::new();
        for tracer in [Tracer::Pipeline, Tracer::Query] {
            let Some(mut gpu) = renderer(GpuOptions {
                tracer: Some(tracer),
                ..GpuOptions::default()
            }) else {
                return;
            };
            let info = gpu.device().info();
            let is_there = if tracer == Tracer::Pipeline {
                info.has_ray_tracing()
            } else {
                info.has_ray_queries()
            };
            if !is_there {
                assert!(
                    std::env::var_os("VACUA_GPU_REQUIRED").is_none(),
                    "{tracer:?}"
                );
                continue;
            }
            for skip in [SkipMethod::None, SkipMethod::Grid] {
                let settings = RenderSettings {
                    skip,
                    ..mesh_settings()
                };
                pictures.push(gpu.render(&leaves, &settings).expect("a good scene").frame);
            }
            let bytes = gpu.mesh_bytes().expect("a mesh");
            assert!(bytes.structures > 0, "the structure is counted");
            assert_valid(&gpu);
        }
        for picture in &pictures {
            assert_same_bits(&format!("{kind}, traced"), picture, &pictures[0]);
            assert_alike(&format!("{kind}, traced"), picture, &expected);
        }
    }
}
