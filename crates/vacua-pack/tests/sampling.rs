//! Location and interpolation from the packed form, against brute force and closed forms.

mod common;

use common::{CUTS, Cut, Random, lattice};
use vacua_pack::{
    EncodeOptions, Encoded, Location, MeshLocator, PackedField, Variant, encode, interpolate,
    weights_at, weights_at_f64,
};
use vacua_volume::{Association, CellMask, DataArray, ScalarType, UnstructuredMesh};

const VARIANTS: [Variant; 3] = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];

fn encoded(mesh: &UnstructuredMesh, variant: Variant, index_bits: u32) -> Encoded {
    let options = EncodeOptions {
        variant,
        index_bits,
    };
    encode(mesh, options).expect("encodable")
}

/// The first cell in packed order that accepts a position.
fn brute_force(encoded: &Encoded, position: [f64; 3]) -> Option<(u32, u64)> {
    let packed = &encoded.mesh;
    packed.cells().find_map(|cell| {
        let submesh = packed.submesh(cell.submesh as usize)?;
        let corners = submesh.corner_positions(&cell)?;
        let local = [0, 1, 2].map(|i| position[i] - submesh.header.origin[i]);
        weights_at(cell.cell_type, &corners, local).map(|_| (cell.submesh, cell.index))
    })
}

fn place(location: &Location) -> (u32, u64) {
    (location.cell.submesh, location.cell.index)
}

#[test]
fn a_random_cloud_is_located_as_by_brute_force() {
    for cut in CUTS {
        for variant in VARIANTS {
            let mut random = Random(77);
            let mesh = lattice(7, cut, 0.25, 6).mesh();
            let encoded = encoded(&mesh, variant, 8);
            assert!(encoded.mesh.submeshes().len() > 1);
            let mut locator = encoded.mesh.locator();
            let mut found = 0;
            for i in 0..400 {
                let mut p = [0; 3].map(|_| random.between(-0.5, 7.5));
                match i % 4 {
                    // On vertices, and on axis-parallel planes through them.
                    0 => {
                        p = mesh
                            .position(random.next() as usize % mesh.num_points())
                            .to_array()
                    }
                    1 => p[0] = mesh.position(i % mesh.num_points()).x,
                    _ => {}
                }
                let location = locator.locate(p);
                assert_eq!(
                    location.as_ref().map(place),
                    brute_force(&encoded, p),
                    "{p:?}"
                );
                found += usize::from(location.is_some());
            }
            assert!(found > 200);
            assert!(locator.counters().num_cells < 400 * 200);
            assert_eq!(locator.locate([f64::NAN, 1.0, 1.0]), None);
            assert_eq!(locator.locate([f64::INFINITY; 3]), None);
        }
    }
}

/// A linear field is exact to 8 units in the last place of its range, in every kind of cell, at every
/// scale; and no point inside conforming cells is missed.
#[test]
fn linear_fields_are_exact_at_every_scale() {
    for cut in [Cut::Tetrahedra, Cut::Wedges, Cut::Pyramids, Cut::Hexahedra] {
        for scale in [1e-9, 1e-3, 1.0, 1e5, 1e9] {
            let n = 6;
            // Points on the outside keep their planes, so that the cube is filled.
            let jitter = 0.15;
            let soup = lattice(n, cut, jitter, 3).placed(scale, [0.3 * scale; 3]);
            let mesh = soup.mesh();
            let field = |p: [f64; 3]| (2.0 * p[0] - 3.0 * p[1] + 0.5 * p[2]) / scale + 1.0;
            let values: Vec<f64> = (0..mesh.num_points())
                .map(|i| field(mesh.position(i).to_array()))
                .collect();
            let range = 5.5 * n as f64;
            let values = DataArray::from_vec(values, 1).expect("column");
            for variant in VARIANTS {
                let encoded = encoded(&mesh, variant, 9);
                let packed = &encoded.mesh;
                let field_packed =
                    PackedField::pack(packed, &encoded.map, "f", Association::Point, &values)
                        .expect("fits");
                let mut random = Random(5);
                let mut locator = packed.locator();
                for _ in 0..500 {
                    let inner = |r: &mut Random| {
                        scale * (0.3 + r.between(2.0 * jitter, n as f64 - 2.0 * jitter))
                    };
                    let p = [0; 3].map(|_| inner(&mut random));
                    let location = locator.locate(p).expect("inside");
                    let value = field_packed.value_at(packed, &location).expect("a number");
                    let off = (value - field(p)).abs();
                    let most = 8.0 * f64::from(f32::EPSILON) * range;
                    assert!(off <= most, "{cut:?} {scale} {variant:?}: {off}");
                }
            }
        }
    }
}

#[test]
fn cell_fields_and_every_number_type_follow_their_cells() {
    let mesh = lattice(6, Cut::Mixed, 0.2, 11).mesh();
    for variant in VARIANTS {
        let encoded = encoded(&mesh, variant, 9);
        let packed = &encoded.mesh;
        let numbers: Vec<u32> = (0..mesh.num_cells() as u32).collect();
        let numbers = DataArray::from_vec(numbers, 1).expect("column");
        let field = PackedField::pack(packed, &encoded.map, "n", Association::Cell, &numbers)
            .expect("fits");
        assert_eq!(field.values().scalar_type(), ScalarType::U32);
        let mut order = packed
            .cells()
            .enumerate()
            .map(|(i, c)| ((c.submesh, c.index), i));
        let order: std::collections::HashMap<_, _> = order.by_ref().collect();
        let mut random = Random(2);
        let mut locator = packed.locator();
        for _ in 0..500 {
            let p = [0; 3].map(|_| random.between(0.0, 6.0));
            if let Some(location) = locator.locate(p) {
                let expected = encoded.map.cells.get(order[&place(&location)]) as f64;
                assert_eq!(field.value_at(packed, &location), Some(expected));
            }
        }
    }
}

/// Ranges of leaves, nodes and sub-meshes contain what is sampled; a NaN is nothing.
#[test]
fn ranges_contain_all_samples() {
    let soup = lattice(8, Cut::Mixed, 0.2, 21);
    let mesh = soup.mesh();
    let mut random = Random(3);
    let mut values: Vec<f32> = (0..mesh.num_points())
        .map(|_| random.between(-5.0, 7.0) as f32)
        .collect();
    values[100] = f32::NAN;
    let values = DataArray::from_vec(values, 1).expect("column");
    for variant in VARIANTS {
        let encoded = encoded(&mesh, variant, 9);
        let packed = &encoded.mesh;
        let field = PackedField::pack(packed, &encoded.map, "f", Association::Point, &values)
            .expect("fits");
        let mut locator = packed.locator();
        let (mut inside, mut nothing) = (0, 0);
        for _ in 0..3000 {
            let p = [0; 3].map(|_| random.between(0.0, 8.0));
            let Some(location) = locator.locate(p) else {
                continue;
            };
            let Some(value) = field.value_at(packed, &location) else {
                nothing += 1;
                continue;
            };
            inside += 1;
            let submesh = location.cell.submesh as usize;
            let ranges = [
                field.submesh_range(submesh),
                field.node_range(packed, submesh, location.node),
            ];
            for range in ranges {
                let range = range.expect("values");
                assert!(range.lo <= value && value <= range.hi);
            }
            let in_a_child = (0..8).any(|child| {
                let range = field.child_range(packed, submesh, location.node, child);
                range.is_some_and(|r| r.lo <= value && value <= r.hi)
            });
            assert!(in_a_child);
        }
        assert!(inside > 1000 && nothing > 0, "{inside} {nothing}");
    }
}

/// The locator over the mesh as it came: a linear field in `f64`, to 8 units in the last place of its
/// range and of the coordinates that it is a function of, and the lowest cell of brute force.
#[test]
fn the_mesh_itself_gives_linear_fields_back_in_f64() {
    for cut in [Cut::Tetrahedra, Cut::Wedges, Cut::Pyramids, Cut::Hexahedra] {
        for scale in [1e-9, 1.0, 1e9] {
            let n = 5;
            let mesh = lattice(n, cut, 0.15, 3).placed(scale, [0.0; 3]).wide_mesh();
            let locator = MeshLocator::new(&mesh);
            let value = |p: glam::DVec3| 1.0 + (2.0 * p.x - 3.0 * p.y + 0.5 * p.z) / scale;
            let width = 5.5 * n as f64;
            let (mut random, mut found, mut worst) = (Random(5), 0, 0.0f64);
            for _ in 0..2000 {
                let p = [0; 3].map(|_| random.between(0.2, n as f64 - 0.2) * scale);
                let Some((cell, weights)) = locator.locate(p.into()) else {
                    continue;
                };
                found += 1;
                let cell = mesh.cell(cell);
                let values: Vec<f64> = cell
                    .points()
                    .iter()
                    .map(|&q| value(mesh.position(q as usize)))
                    .collect();
                let got = interpolate(&weights, &values).expect("finite");
                worst = worst.max((got - value(p.into())).abs() / (width * f64::EPSILON));
            }
            assert_eq!(found, 2000, "{cut:?}");
            assert!(worst <= 8.0, "{cut:?} at {scale}: {worst} ulp");
        }
    }
}

#[test]
fn the_mesh_itself_answers_as_brute_force_does() {
    let mut mesh = lattice(4, Cut::Mixed, 0.25, 8).mesh();
    let mut mask = CellMask::new(mesh.num_cells());
    (0..mesh.num_cells())
        .step_by(7)
        .for_each(|cell| mask.blank(cell));
    mesh = mesh.with_blanked_cells(mask.clone()).expect("fits");
    let locator = MeshLocator::new(&mesh);
    let mut random = Random(9);
    let mut found = 0;
    for _ in 0..500 {
        let p = [0; 3].map(|_| random.between(-0.5, 4.5));
        let expected = (0..mesh.num_cells())
            .filter(|&c| !mask.is_blank(c))
            .find(|&c| {
                let cell = mesh.cell(c);
                let mut corners = [[0.0; 3]; 8];
                for (to, &q) in corners.iter_mut().zip(cell.points()) {
                    *to = mesh.position(q as usize).to_array();
                }
                weights_at_f64(cell.cell_type, &corners, p).is_some()
            });
        assert_eq!(locator.locate(p.into()).map(|(cell, _)| cell), expected);
        found += usize::from(expected.is_some());
    }
    assert!(found > 200);
    let empty = UnstructuredMesh::mixed(
        DataArray::from_vec(Vec::<f64>::new(), 3).expect("none"),
        Vec::new(),
        DataArray::from_vec(Vec::<u32>::new(), 1).expect("none"),
    );
    let empty = MeshLocator::new(&empty.expect("valid"));
    assert_eq!(empty.locate(glam::DVec3::ZERO), None);
}
