//! The variant `small`: as small as it says, and the same bits as the others.

mod common;

use common::{CUTS, Cut, Random, lattice};
use vacua_pack::{
    BlockSampler, EncodeOptions, Encoded, PackedCell, PackedField, PackedMesh, Variant, encode,
    weights_at,
};
use vacua_simd::LANES;
use vacua_synth::{MeshKind, MeshSpec, generate_mesh};
use vacua_volume::{
    Association, ComponentChoice, DataArray, Dataset, FieldChoice, UnstructuredMesh,
};

fn encoded(mesh: &UnstructuredMesh, variant: Variant, index_bits: u32) -> Encoded {
    let options = EncodeOptions {
        variant,
        index_bits,
    };
    encode(mesh, options).expect("encodable")
}

fn pack(encoded: &Encoded, association: Association, values: &DataArray) -> PackedField {
    PackedField::pack(&encoded.mesh, &encoded.map, "f", association, values).expect("fits")
}

/// Cells come in the order of variant 1, with the same corners in the same order: that is why ties
/// and rounding are the same too.
#[test]
fn cells_are_those_of_variant_1_in_their_order() {
    for cut in CUTS {
        for bits in [8, 16] {
            let mesh = lattice(9, cut, 0.2, 5).mesh();
            let one = encoded(&mesh, Variant::MultiLeaves, bits);
            let small = encoded(&mesh, Variant::Small, bits);
            assert_eq!(one.map, small.map);
            let (mut a, mut b) = (one.mesh.cells(), small.mesh.cells());
            for i in 0..mesh.num_cells() {
                let (a, b) = (a.next().expect("a cell"), b.next().expect("a cell"));
                assert_eq!(
                    (a.submesh, a.cell_type, a.corners()),
                    (b.submesh, b.cell_type, b.corners())
                );
                let (s, t) = (
                    one.mesh.submesh(a.submesh as usize),
                    small.mesh.submesh(b.submesh as usize),
                );
                let (s, t) = (s.expect("there"), t.expect("there"));
                assert_eq!(s.header.first_cell + b.index / 2, i as u64);
                for &corner in a.corners() {
                    let bits = |p: Option<[f32; 3]>| p.map(|p| p.map(f32::to_bits));
                    assert_eq!(bits(s.position(corner)), bits(t.position(corner)));
                }
            }
            assert!(a.next().is_none() && b.next().is_none());
        }
    }
}

/// How many cells accept a place.
fn num_accepting(encoded: &Encoded, at: [f64; 3]) -> usize {
    let mesh = &encoded.mesh;
    let accepts = |cell: &PackedCell| {
        let mut corners = [[0.0; 3]; 8];
        let submesh = mesh.submesh(cell.submesh as usize).expect("there");
        for (corner, &vertex) in corners.iter_mut().zip(cell.corners()) {
            *corner = submesh.position(vertex).expect("there");
        }
        weights_at(cell.cell_type, &corners, at).is_some()
    };
    mesh.cells().filter(accepts).count()
}

/// Values, scalar and in vectors, on points and on cells, are those of variant 1 to the last bit
/// wherever the place is, and those of variant 2 where no two cells accept it.
#[test]
fn samples_have_the_bits_of_the_other_variants() {
    for cut in CUTS {
        for jitter in [0.0, 0.2] {
            let mesh = lattice(8, cut, jitter, 5).mesh();
            let mut random = Random(4);
            let values = (0..mesh.positions().tuples()).map(|_| random.between(-3.0, 9.0) as f32);
            let values = DataArray::from_vec(values.collect(), 1).expect("column");
            let numbers = DataArray::from_vec((0..mesh.num_cells() as u32).collect(), 1);
            let numbers = numbers.expect("column");
            let all = [Variant::MultiLeaves, Variant::Small, Variant::MultiNodes]
                .map(|variant| encoded(&mesh, variant, 9));
            let on_points = all.each_ref().map(|e| pack(e, Association::Point, &values));
            let on_cells = all.each_ref().map(|e| pack(e, Association::Cell, &numbers));
            let mut locators = all.each_ref().map(|e| e.mesh.locator());
            for round in 0..60 {
                let at: [[f32; LANES]; 3] = std::array::from_fn(|_| {
                    std::array::from_fn(|_| match round % 3 {
                        // On planes of the lattice, or anywhere.
                        0 => (random.next() % 17) as f32 * 0.5,
                        _ => random.between(-0.3, 8.3) as f32,
                    })
                });
                let tied = round % 3 == 0;
                for fields in [&on_points, &on_cells] {
                    let sampled = [0, 1, 2].map(|i| {
                        let sampler = BlockSampler::new(&all[i].mesh, &fields[i], None);
                        let sampled = sampler.sample(&at, u16::MAX);
                        let gradients = sampler.gradients(&at, &sampled.located);
                        let bits = |values: [f32; LANES]| {
                            let valid = sampled.valid;
                            (0..LANES)
                                .map(|k| {
                                    if valid >> k & 1 == 1 {
                                        values[k].to_bits()
                                    } else {
                                        0
                                    }
                                })
                                .collect::<Vec<u32>>()
                        };
                        (sampled.valid, bits(sampled.values), gradients.map(bits))
                    });
                    assert_eq!(sampled[0], sampled[1], "{cut:?} {jitter}");
                    for lane in 0..LANES {
                        let p = at.map(|c| f64::from(c[lane]));
                        let of_lane = |i: usize| {
                            let (valid, values, gradients) = &sampled[i];
                            let gradient = gradients.each_ref().map(|g| g[lane]);
                            (valid >> lane & 1, values[lane], gradient)
                        };
                        // Each variant has its own first cell, where there are several.
                        assert!(
                            tied || of_lane(1) == of_lane(2) || num_accepting(&all[0], p) > 1,
                            "{cut:?} {jitter}"
                        );
                        let [one, small, _] = [0, 1, 2].map(|i| {
                            let location = locators[i].locate_local(p)?;
                            fields[i]
                                .value_at(&all[i].mesh, &location)
                                .map(f64::to_bits)
                        });
                        assert_eq!(one, small);
                    }
                }
            }
        }
    }
}

fn bytes_a_cell(dataset: &Dataset, variant: Variant) -> f64 {
    let mesh = dataset.mesh().expect("a mesh");
    let volume = dataset
        .volume(&FieldChoice::Only, ComponentChoice::Auto)
        .expect("a field");
    let encoded = encoded(mesh, variant, 16);
    let field = pack(&encoded, Association::Point, volume.scalars());
    let (a, b) = (encoded.mesh.bytes(), field.bytes());
    (a.total() + b.values + b.ranges) as f64 / mesh.num_cells() as f64
}

/// The benchmark scenes, smaller (so that more of their points lie outside), in random order:
/// everything that is in the file but its table.
#[test]
fn the_targets_are_met() {
    for (kind, size, most) in [(MeshKind::Tet100, 40, 6.0), (MeshKind::Hex150, 40, 24.0)] {
        let spec = MeshSpec {
            size,
            shuffled: true,
            ..MeshSpec::new(kind)
        };
        let dataset = generate_mesh(&spec).expect("a mesh");
        let small = bytes_a_cell(&dataset, Variant::Small);
        assert!(small <= most, "{kind}: {small}");
        assert!(small < 0.66 * bytes_a_cell(&dataset, Variant::MultiNodes));
    }
}

/// A wedge takes six indices, a pyramid five; leaves of several kinds too.
#[test]
fn every_kind_of_cell_is_smaller() {
    for cut in [Cut::Wedges, Cut::Pyramids, Cut::Mixed] {
        let mesh = lattice(16, cut, 0.1, 3).mesh();
        let bytes = |variant| {
            let encoded = encoded(&mesh, variant, 16);
            encoded.mesh.bytes().total() as f64 / mesh.num_cells() as f64
        };
        let (two, small) = (bytes(Variant::MultiNodes), bytes(Variant::Small));
        assert!(small < 0.66 * two, "{cut:?}: {small} against {two}");
    }
}

/// Default colours look at all values, or at every so many.
#[test]
fn values_in_frames_are_looked_at_as_others_are() {
    let mesh = lattice(12, Cut::Mixed, 0.1, 3).mesh();
    for (association, count) in [
        (Association::Point, mesh.positions().tuples()),
        (Association::Cell, mesh.num_cells()),
    ] {
        let values: Vec<f32> = (0..count).map(|i| 293.0 + (i as f32).sqrt()).collect();
        let values = DataArray::from_vec(values, 1).expect("one component");
        let [two, small] = [Variant::MultiNodes, Variant::Small].map(|variant| {
            let encoded = encoded(&mesh, variant, 16);
            (pack(&encoded, association, &values), encoded.mesh)
        });
        assert_eq!(small.0.profile(&small.1), two.0.profile(&two.1));
        let sorted = |(field, mesh): &(PackedField, PackedMesh), most| {
            let values = field.some_values(mesh, most);
            let mut values: Vec<f64> = (0..values.tuples()).map(|i| values.get_f64(i, 0)).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        // Shared vertices are there once a sub-mesh, and this mesh has but one.
        assert_eq!(sorted(&small, usize::MAX), sorted(&two, usize::MAX));
        let few = sorted(&small, 100);
        assert!((50..=100).contains(&few.len()), "{}", few.len());
    }
}
