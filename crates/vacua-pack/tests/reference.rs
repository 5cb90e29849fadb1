//! Reference encodings find the cells of the packed form and give its values, to the bit.

mod common;

use std::collections::HashMap;

use common::{CUTS, Cut, Random, lattice};
use vacua_pack::reference::{
    Cells, Found, LinkedBvh, MinMaxBvh, RaySamples, Reference, ReferenceError, SharedFaces,
    TetMarch, UserGeometry,
};
use vacua_pack::{BlockSampler, EncodeOptions, Encoded, PackedField, Variant, encode};
use vacua_simd::LANES;
use vacua_volume::{Association, DataArray, UnstructuredMesh};

/// An encoded mesh with a field of its points' values.
struct Case {
    encoded: Encoded,
    field: PackedField,
    /// Numbers of cells by sub-mesh and primitive.
    numbers: HashMap<(u32, u64), u32>,
}

impl Case {
    fn new(mesh: &UnstructuredMesh, values: Vec<f32>, variant: Variant) -> Self {
        let options = EncodeOptions {
            variant,
            index_bits: 8,
        };
        let encoded = encode(mesh, options).expect("encodable");
        let values = DataArray::from_vec(values, 1).expect("a column");
        let field = PackedField::pack(
            &encoded.mesh,
            &encoded.map,
            "f",
            Association::Point,
            &values,
        );
        let cells = encoded.mesh.cells();
        let numbers = cells.zip(0u32..).map(|(c, i)| ((c.submesh, c.index), i));
        Self {
            numbers: numbers.collect(),
            field: field.expect("fits"),
            encoded,
        }
    }

    fn lattice(n: usize, cut: Cut, seed: u64) -> Self {
        let mesh = lattice(n, cut, 0.15, seed).mesh();
        let mut random = Random(seed + 1);
        let values = (0..mesh.num_points()).map(|_| random.between(-1.0, 2.0) as f32);
        Self::new(&mesh, values.collect(), Variant::MultiNodes)
    }

    fn cells(&self) -> Cells {
        Cells::new(&self.encoded.mesh, &self.encoded.map, &self.field).expect("it fits")
    }

    /// Number and value of the cell at a place, by the scalar locator.
    fn expected(&self, place: [f32; 3]) -> Option<(u32, f32)> {
        let mesh = &self.encoded.mesh;
        let location = mesh.locator().locate_local(place.map(f64::from))?;
        let number = self.numbers[&(location.cell.submesh, location.cell.index)];
        let value = self.field.value_at(mesh, &location)?;
        Some((number, value as f32))
    }

    fn check(&self, reference: &dyn Reference, places: &[[f32; 3]]) -> usize {
        let mut found_in_all = 0;
        for sixteen in places.chunks(LANES) {
            let mut at = [[f32::NAN; LANES]; 3];
            for (lane, place) in sixteen.iter().enumerate() {
                (0..3).for_each(|axis| at[axis][lane] = place[axis]);
            }
            let found = reference.sample(&at, ((1u32 << sixteen.len()) - 1) as u16);
            for (lane, &place) in sixteen.iter().enumerate() {
                let name = reference.name();
                let actual = lane_of(&found, lane);
                assert_eq!(actual, self.expected(place), "{name} at {place:?}");
                found_in_all += usize::from(actual.is_some());
            }
        }
        found_in_all
    }

    /// The same along a ray.
    fn check_ray(&self, reference: &dyn Reference, ray: &RaySamples, count: usize) -> usize {
        let mut values = vec![0.0; count];
        reference.sample_ray(ray, &mut values);
        for (k, value) in (ray.first..).zip(&values) {
            let expected = self.expected(ray.at(k)).map(|e| e.1);
            let actual = (!value.is_nan()).then_some(*value);
            let name = reference.name();
            assert_eq!(actual, expected, "{name}, sample {k} of {ray:?}");
        }
        values.iter().filter(|v| !v.is_nan()).count()
    }
}

fn lane_of(found: &Found, lane: usize) -> Option<(u32, f32)> {
    (found.valid >> lane & 1 == 1).then_some((found.cells[lane], found.values[lane]))
}

/// Random places around an `n`³ lattice, and such that are nowhere or on its planes.
fn places(n: usize, count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut random = Random(seed);
    let mut all: Vec<[f32; 3]> = (0..count)
        .map(|_| [0; 3].map(|_| random.between(-0.3, n as f64 + 0.3) as f32))
        .collect();
    all.push([f32::NAN, 1.0, 1.0]);
    all.push([1e30; 3]);
    all
}

fn rays(n: usize, count: usize, seed: u64) -> Vec<RaySamples> {
    let mut random = Random(seed);
    let mut ray = || {
        let through = [0; 3].map(|_| random.between(0.0, n as f64));
        let mut step = [0; 3].map(|_| random.between(-0.3, 0.3));
        if random.unit() < 0.2 {
            step[1] = 0.0;
        }
        RaySamples {
            start: [0, 1, 2].map(|a| (through[a] - 60.0 * step[a]) as f32),
            step: step.map(|s| s as f32),
            first: (random.unit() * 20.0) as u32,
        }
    };
    (0..count).map(|_| ray()).collect()
}

#[test]
fn searching_references_agree_with_the_packed_form() {
    for (seed, cut) in (0..).zip(CUTS) {
        let n = 5;
        let case = Case::lattice(n, cut, seed);
        let cells = case.cells();
        let references: [&dyn Reference; 3] = [
            &MinMaxBvh::new(&cells),
            &LinkedBvh::new(&cells),
            &UserGeometry::new(&cells),
        ];
        for reference in references {
            assert_eq!(reference.num_cells(), case.encoded.mesh.num_cells());
            assert!(case.check(reference, &places(n, 600, seed)) > 300);
            let inside: usize = rays(n, 6, seed)
                .iter()
                .map(|ray| case.check_ray(reference, ray, 111))
                .sum();
            assert!(inside > 40, "{inside}");
        }
    }
}

#[test]
fn marching_references_agree_with_the_packed_form() {
    for seed in 0..3 {
        let n = 5;
        let case = Case::lattice(n, Cut::Tetrahedra, seed);
        let cells = case.cells();
        let shared = SharedFaces::new(&cells).expect("tetrahedra");
        let march = TetMarch::new(&cells).expect("tetrahedra");
        let references: [&dyn Reference; 2] = [&shared, &march];
        for reference in references {
            assert!(case.check(reference, &places(n, 600, seed)) > 300);
            let inside: usize = rays(n, 60, seed)
                .iter()
                .map(|ray| case.check_ray(reference, ray, 111))
                .sum();
            assert!(inside > 400, "{inside}");
        }
    }
}

/// Places on vertices, edges and faces, of which several cells accept each: the lowest wins.
#[test]
fn ties_are_broken_as_in_the_packed_form() {
    let n = 3;
    let mesh = lattice(n, Cut::Tetrahedra, 0.0, 3).mesh();
    let values = (0..mesh.num_points()).map(|i| i as f32).collect();
    let case = Case::new(&mesh, values, Variant::MultiLeaves);
    let cells = case.cells();
    let side = 2 * n + 1;
    let halves = |i: usize| [i % side, i / side % side, i / side / side].map(|c| c as f32 / 2.0);
    let places: Vec<_> = (0..side * side * side).map(halves).collect();
    let references: [&dyn Reference; 5] = [
        &MinMaxBvh::new(&cells),
        &LinkedBvh::new(&cells),
        &UserGeometry::new(&cells),
        &SharedFaces::new(&cells).expect("tetrahedra"),
        &TetMarch::new(&cells).expect("tetrahedra"),
    ];
    for reference in references {
        assert_eq!(case.check(reference, &places), places.len());
    }
}

/// Inverted, flat and overlapping cells are what searching takes in its stride.
#[test]
fn searching_takes_bad_cells() {
    let mut soup = lattice(4, Cut::Mixed, 0.45, 9);
    let mut random = Random(4);
    for cell in &mut soup.cells {
        if random.unit() < 0.2 {
            let to = cell.1[1];
            cell.1[0] = to;
        }
        if random.unit() < 0.2 {
            cell.1.swap(0, 2);
        }
    }
    let mesh = soup.mesh();
    let values = (0..mesh.num_points()).map(|i| i as f32).collect();
    let case = Case::new(&mesh, values, Variant::MultiNodes);
    let cells = case.cells();
    let references: [&dyn Reference; 3] = [
        &MinMaxBvh::new(&cells),
        &LinkedBvh::new(&cells),
        &UserGeometry::new(&cells),
    ];
    for reference in references {
        assert!(case.check(reference, &places(4, 500, 8)) > 100);
    }
}

/// The fast packed code computes weights in `f32`.
#[test]
fn sixteen_packed_places_have_nearly_the_same_values() {
    for cut in [Cut::Tetrahedra, Cut::Hexahedra] {
        let case = Case::lattice(5, cut, 2);
        let sampler = BlockSampler::new(&case.encoded.mesh, &case.field, None);
        let reference = UserGeometry::new(&case.cells());
        for ray in rays(5, 30, 7) {
            let at = ray.places(60);
            let (packed, found) = (
                sampler.sample(&at, u16::MAX),
                reference.sample(&at, u16::MAX),
            );
            assert_eq!(packed.valid, found.valid);
            for lane in 0..LANES {
                let off = (packed.values[lane] - found.values[lane]).abs();
                assert!(packed.valid >> lane & 1 == 0 || off < 3e-5, "{off}");
            }
        }
    }
}

/// Paper B, Table 6 (Jets, 12 M tetrahedra of 2 M vertices) and §3; see the module.
#[test]
fn bytes_are_those_of_the_paper() {
    let case = Case::lattice(28, Cut::Tetrahedra, 5);
    let cells = case.cells();
    let per_cell = |reference: &dyn Reference| {
        let parts: usize = reference.parts().iter().map(|part| part.1).sum();
        assert_eq!(parts, reference.num_bytes());
        reference.num_bytes() as f64 / reference.num_cells() as f64
    };
    let near = |bytes: f64, paper: f64| (bytes / paper - 1.0).abs() <= 0.15;
    let user = per_cell(&UserGeometry::new(&cells));
    let shared = per_cell(&SharedFaces::new(&cells).expect("tetrahedra"));
    let march = per_cell(&TetMarch::new(&cells).expect("tetrahedra"));
    assert!(
        near(user, 70.0) && near(shared, 175.0) && near(march, 38.0),
        "{user} {shared} {march}"
    );
    let vertices = 16.0 * cells.vertices().len() as f64 / cells.cells().len() as f64;
    let min_max = per_cell(&MinMaxBvh::new(&cells));
    let expected = vertices + 32.0 + 8.0 + 2.0 * 40.0;
    assert!((min_max - expected).abs() < 0.1, "{min_max}");
    let linked = per_cell(&LinkedBvh::new(&cells));
    let expected = vertices + 16.0 + 5.0 + 96.0 + 64.0;
    assert!((linked - expected).abs() < 0.1, "{linked}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let case = Case::lattice(2, Cut::Mixed, 1);
    let cells = case.cells();
    let refused =
        |e: Option<ReferenceError>| matches!(e, Some(ReferenceError::NotTetrahedron { .. }));
    assert!(refused(SharedFaces::new(&cells).err()));
    assert!(refused(TetMarch::new(&cells).err()));
    let mesh = &case.encoded.mesh;
    let other = Case::lattice(3, Cut::Mixed, 1);
    let mixed_up = Cells::new(mesh, &other.encoded.map, &case.field);
    assert!(matches!(mixed_up, Err(ReferenceError::Mismatch { .. })));
    let values = DataArray::from_vec(vec![0f32; mesh.num_cells() as usize], 1).expect("a column");
    let on_cells =
        PackedField::pack(mesh, &case.encoded.map, "c", Association::Cell, &values).expect("fits");
    let refused = Cells::new(mesh, &case.encoded.map, &on_cells);
    assert!(matches!(refused, Err(ReferenceError::Association { .. })));
}

#[test]
fn nothing_is_found_in_nothing() {
    let cells = Cells::default();
    let references: [&dyn Reference; 5] = [
        &MinMaxBvh::new(&cells),
        &LinkedBvh::new(&cells),
        &UserGeometry::new(&cells),
        &SharedFaces::new(&cells).expect("no cell is no tetrahedron"),
        &TetMarch::new(&cells).expect("no cell is no tetrahedron"),
    ];
    for reference in references {
        assert_eq!(reference.sample(&[[0.5; LANES]; 3], u16::MAX).valid, 0);
        assert_eq!(reference.num_cells(), 0);
    }
    assert_eq!(MinMaxBvh::new(&cells).range(), None);
    assert_eq!(LinkedBvh::new(&cells).nominal_length(), None);
}

#[test]
fn hierarchies_know_ranges() {
    let case = Case::lattice(3, Cut::Hexahedra, 6);
    let cells = case.cells();
    let values = cells.vertices().iter().map(|v| v[3]);
    let lo = values.clone().fold(f32::INFINITY, f32::min);
    let hi = values.fold(f32::NEG_INFINITY, f32::max);
    assert_eq!(MinMaxBvh::new(&cells).range(), Some([lo, hi]));
    let linked = LinkedBvh::new(&cells);
    assert_eq!(linked.range(), Some([lo, hi]));
    let side = linked.nominal_length().expect("cells");
    assert!(side > 0.5 && side < 1.1, "{side}");
}
