//! Sixteen places at once, against brute force, the scalar locator and closed forms, on every
//! instruction set.

mod common;

use common::{CUTS, Cut, Random, Soup, lattice};
use proptest::prelude::*;
use vacua_pack::{
    BlockSampler, EncodeOptions, Encoded, Order, PackedField, Places, Sampled, Variant, encode,
    gradient_at, interpolate, weights_at,
};
use vacua_simd::{LANES, Level};
use vacua_volume::{Association, CellType, DataArray, UnstructuredMesh};

const VARIANTS: [Variant; 3] = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];

fn encoded(mesh: &UnstructuredMesh, variant: Variant, index_bits: u32) -> Encoded {
    let options = EncodeOptions {
        variant,
        index_bits,
    };
    encode(mesh, options).expect("encodable")
}

fn column(values: Vec<f64>) -> DataArray {
    DataArray::from_vec(values, 1).expect("one column")
}

/// A mesh and a field of its points' numbers, which no mistake leaves unseen.
fn with_field(soup: &Soup, variant: Variant, index_bits: u32) -> (Encoded, PackedField) {
    let mesh = soup.mesh();
    let encoded = encoded(&mesh, variant, index_bits);
    let numbers = column((0..mesh.num_points()).map(|i| i as f64).collect());
    let field = PackedField::pack(
        &encoded.mesh,
        &encoded.map,
        "n",
        Association::Point,
        &numbers,
    );
    (encoded, field.expect("fits"))
}

/// The first cell in packed order that accepts a place, with the interpolated value.
fn brute_force(encoded: &Encoded, field: &PackedField, at: [f32; 3]) -> Option<(u32, u64, f64)> {
    let packed = &encoded.mesh;
    packed.cells().find_map(|cell| {
        let submesh = packed.submesh(cell.submesh as usize)?;
        let corners = submesh.corner_positions(&cell)?;
        let weights = weights_at(cell.cell_type, &corners, at.map(f64::from))?;
        let corner_values = cell.corners().iter();
        let corner_values: Option<Vec<f64>> = corner_values
            .map(|&c| field.point_value(submesh.header, c))
            .collect();
        let corner_values = corner_values?;
        let value = interpolate(&weights, &corner_values)?;
        Some((cell.submesh, cell.index, value))
    })
}

fn bits(sampled: &Sampled) -> Vec<u64> {
    let located = &sampled.located;
    let mut bits = vec![u64::from(sampled.valid), u64::from(located.found)];
    for lane in (0..LANES).filter(|lane| located.found >> lane & 1 == 1) {
        bits.extend([
            u64::from(sampled.values[lane].to_bits()),
            u64::from(located.submesh[lane]),
            located.primitive[lane],
            u64::from(located.others >> lane & 1),
        ]);
    }
    bits
}

/// Samples in both orders on every instruction set, compares the bits, and gives one of the answers.
fn sample_everywhere(sampler: &BlockSampler, at: &Places, lanes: u16) -> Sampled {
    let sample = |level, order| {
        let mut sampled = [Sampled::default()];
        sampler.sample_all_at(level, order, &[*at], &[lanes], &mut sampled);
        sampled[0]
    };
    let portable = sample(Level::Baseline, Order::Scattered);
    for level in Level::available() {
        for order in [Order::Scattered, Order::Compact] {
            let here = sample(level, order);
            assert_eq!(bits(&here), bits(&portable), "{level:?} {order:?}");
        }
    }
    portable
}

/// Compares sixteen answers with brute force; gives how many places are inside.
fn check(encoded: &Encoded, field: &PackedField, at: &Places, lanes: u16, tolerance: f64) -> u32 {
    let sampler = BlockSampler::new(&encoded.mesh, field, None);
    let sampled = sample_everywhere(&sampler, at, lanes);
    assert_eq!(sampled.valid & !lanes, 0);
    let located = &sampled.located;
    let mut locator = encoded.mesh.locator();
    for lane in (0..LANES).filter(|lane| lanes >> lane & 1 == 1) {
        let p = at.map(|c| c[lane]);
        let expected = brute_force(encoded, field, p);
        let inside = located.found >> lane & 1 == 1;
        let found = inside.then(|| (located.submesh[lane], located.primitive[lane]));
        assert_eq!(found, expected.map(|(s, i, _)| (s, i)), "{p:?}");
        let scalar = locator.locate_local(p.map(f64::from));
        let scalar_place = scalar.map(|l| (l.cell.submesh, l.cell.index));
        assert_eq!(found, scalar_place);
        if let Some((_, _, value)) = expected {
            let off = (f64::from(sampled.values[lane]) - value).abs();
            assert!(off <= tolerance, "{p:?}: {} {value}", sampled.values[lane]);
        }
    }
    located.found.count_ones()
}

#[test]
fn random_clouds_are_located_as_by_brute_force() {
    for cut in CUTS {
        for variant in VARIANTS {
            let mut random = Random(77);
            let soup = lattice(6, cut, 0.25, 6);
            let mesh = soup.mesh();
            let (encoded, field) = with_field(&soup, variant, 8);
            assert!(encoded.mesh.submeshes().len() > 1);
            let range = mesh.num_points() as f64;
            let mut inside = 0;
            for block in 0..24 {
                let mut at = [[0.0; LANES]; 3];
                for lane in 0..LANES {
                    let vertex = |r: &mut Random| {
                        let i = r.next() as usize % mesh.num_points();
                        mesh.position(i).to_array().map(|c| c as f32)
                    };
                    let mut p = [0; 3].map(|_| random.between(-0.5, 6.5) as f32);
                    match (block + lane) % 5 {
                        0 => p = vertex(&mut random),
                        1 => {
                            // On an edge, give or take rounding.
                            let (a, b) = (vertex(&mut random), vertex(&mut random));
                            p = [0, 1, 2].map(|i| 0.5 * (a[i] + b[i]));
                        }
                        2 => p[0] = vertex(&mut random)[0],
                        _ => {}
                    }
                    (0..3).for_each(|i| at[i][lane] = p[i]);
                }
                let lanes = if block % 3 == 0 { 0x5AF3 } else { u16::MAX };
                inside += check(&encoded, &field, &at, lanes, 1e-5 * range);
            }
            assert!(inside > 150, "{inside}");
        }
    }
}

#[test]
fn rays_are_sampled_as_by_brute_force() {
    for cut in CUTS {
        let mut random = Random(5);
        let soup = lattice(6, cut, 0.2, 2);
        let (encoded, field) = with_field(&soup, Variant::MultiNodes, 8);
        for ray in 0..30 {
            let start = [0; 3].map(|_| random.between(0.0, 6.0));
            let mut step = [0; 3].map(|_| random.between(-0.4, 0.4));
            if ray % 4 == 0 {
                // Along an axis, through the lattice's own planes.
                step = [0.25, 0.0, 0.0];
            }
            let at =
                [0, 1, 2].map(|i| std::array::from_fn(|k| (start[i] + k as f64 * step[i]) as f32));
            check(&encoded, &field, &at, u16::MAX, 1e-3);
        }
    }
}

/// Of places in no cell, and of what is no place, nothing is said.
#[test]
fn nowhere_is_nothing() {
    let (encoded, field) = with_field(&lattice(3, Cut::Mixed, 0.1, 1), Variant::MultiNodes, 16);
    let sampler = BlockSampler::new(&encoded.mesh, &field, None);
    let mut at = [[1.5f32; LANES]; 3];
    at[0][0] = f32::NAN;
    at[1][1] = f32::INFINITY;
    at[2][2] = -1e38;
    at[2][3] = f32::MAX;
    let sampled = sample_everywhere(&sampler, &at, 0xFFFF);
    assert_eq!(sampled.valid, 0xFFF0);
    assert_eq!(sampled.values[..4], [0.0; 4]);
    assert_eq!(sample_everywhere(&sampler, &at, 0).valid, 0);
    let (empty, nothing) = with_field(&Soup::default(), Variant::MultiNodes, 16);
    let sampler = BlockSampler::new(&empty.mesh, &nothing, None);
    assert_eq!(sampler.sample(&[[0.0; LANES]; 3], 0xFFFF).located.found, 0);
}

/// A linear field is exact to 8 units in the last place of its range, in every kind of cell, at every
/// scale.
#[test]
fn linear_fields_are_exact_at_every_scale() {
    for cut in [Cut::Tetrahedra, Cut::Wedges, Cut::Pyramids, Cut::Hexahedra] {
        for scale in [1e-9, 1e-3, 1.0, 1e5, 1e9] {
            let (n, jitter) = (6, 0.15);
            let soup = lattice(n, cut, jitter, 3).placed(scale, [0.3 * scale; 3]);
            let mesh = soup.mesh();
            let field = |p: [f64; 3]| (2.0 * p[0] - 3.0 * p[1] + 0.5 * p[2]) / scale + 1.0;
            let values = (0..mesh.num_points()).map(|i| field(mesh.position(i).to_array()));
            let values = column(values.collect());
            let range = 5.5 * n as f64;
            for variant in VARIANTS {
                let encoded = encoded(&mesh, variant, 9);
                let (packed, map) = (&encoded.mesh, &encoded.map);
                let packed_field =
                    PackedField::pack(packed, map, "f", Association::Point, &values).expect("fits");
                let sampler = BlockSampler::new(packed, &packed_field, None);
                let mut random = Random(5);
                for _ in 0..40 {
                    let mut inner = || {
                        let place = random.between(2.0 * jitter, n as f64 - 2.0 * jitter);
                        (scale * (0.3 + place)) as f32
                    };
                    let at: Places = std::array::from_fn(|_| std::array::from_fn(|_| inner()));
                    let sampled = sample_everywhere(&sampler, &at, u16::MAX);
                    assert_eq!(sampled.valid, u16::MAX, "{cut:?} {scale}");
                    for lane in 0..LANES {
                        let exact = field(at.map(|c| f64::from(c[lane])));
                        let off = (f64::from(sampled.values[lane]) - exact).abs();
                        let most = 8.0 * f64::from(f32::EPSILON) * range;
                        assert!(off <= most, "{cut:?} {scale} {variant:?}: {off}");
                    }
                }
            }
        }
    }
}

#[test]
fn cell_fields_follow_their_cells() {
    let mesh = lattice(6, Cut::Mixed, 0.2, 11).mesh();
    for variant in VARIANTS {
        let encoded = encoded(&mesh, variant, 9);
        let (packed, map) = (&encoded.mesh, &encoded.map);
        let numbers = DataArray::from_vec((0..mesh.num_cells() as u32).collect(), 1);
        let numbers = numbers.expect("column");
        let field = PackedField::pack(packed, map, "n", Association::Cell, &numbers).expect("fits");
        let sampler = BlockSampler::new(packed, &field, None);
        let mut random = Random(2);
        let mut locator = packed.locator();
        for _ in 0..40 {
            let at: Places =
                std::array::from_fn(|_| std::array::from_fn(|_| random.between(0.0, 6.0) as f32));
            let sampled = sample_everywhere(&sampler, &at, u16::MAX);
            for lane in 0..LANES {
                let location = locator.locate_local(at.map(|c| f64::from(c[lane])));
                let expected = location.and_then(|l| field.value_at(packed, &l));
                let found = (sampled.valid >> lane & 1 == 1).then_some(sampled.values[lane]);
                assert_eq!(found.map(f64::from), expected);
            }
        }
    }
}

/// More cells on one place than any queue holds.
#[test]
fn crowds_are_served() {
    let mut soup = Soup::default();
    let hex = lattice(1, Cut::Hexahedra, 0.0, 1);
    for i in 0..3000 {
        let grown = hex.clone().placed(1.0 + 1e-4 * f64::from(i), [-0.5; 3]);
        let first = soup.points.len() as u64;
        soup.points.extend(grown.points);
        let corners: Vec<u64> = grown.cells[0].1.iter().map(|c| c + first).collect();
        soup.cells.push((CellType::Hexahedron, corners));
    }
    for variant in VARIANTS {
        let (encoded, field) = with_field(&soup, variant, 10);
        let mut random = Random(8);
        for _ in 0..3 {
            let at: Places =
                std::array::from_fn(|_| std::array::from_fn(|_| random.between(-0.6, 0.9) as f32));
            assert!(check(&encoded, &field, &at, u16::MAX, 0.3) > 4);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Any soup: random corners, repeated and inverted, overlapping, flat and tiny cells.
    #[test]
    fn any_soup_is_searched_as_by_brute_force(
        seed in any::<u64>(),
        num_points in 1usize..40,
        num_cells in 1usize..60,
        bits in prop::sample::select(vec![8u32, 13, 16]),
        power in prop::sample::select(vec![-30, -9, 0, 9, 29]),
        variant in prop::sample::select(VARIANTS.to_vec()),
        flat in prop::bool::weighted(0.2),
        only in prop::option::of(0usize..4),
    ) {
        let mut random = Random(seed);
        let mut soup = Soup::default();
        let scale = 10f64.powi(power);
        for _ in 0..num_points {
            let mut c = || random.between(-1.0, 1.0) * scale;
            soup.points.push([c(), c(), if flat { 0.0 } else { c() }]);
        }
        for _ in 0..num_cells {
            let pick = only.unwrap_or((random.next() % 4) as usize);
            let cell_type = CellType::ALL[pick];
            let corners = (0..cell_type.num_points()).map(|_| random.next() % num_points as u64);
            soup.cells.push((cell_type, corners.collect()));
        }
        let (encoded, field) = with_field(&soup, variant, bits);
        for block in 0..4 {
            let mut at = [[0.0f32; LANES]; 3];
            for lane in 0..LANES {
                let mut p = [0; 3].map(|_| random.between(-1.0, 1.0) * scale);
                if block % 2 == 1 {
                    // On corners, edges, faces and in the middle of some points.
                    let n = 1 + random.next() % 4;
                    p = [0.0; 3];
                    for _ in 0..n {
                        let q = soup.points[random.next() as usize % num_points];
                        (0..3).for_each(|i| p[i] += q[i] / n as f64);
                    }
                }
                (0..3).for_each(|i| at[i][lane] = p[i] as f32);
            }
            // Values of cells that fold over themselves are compared loosely; the cells are not.
            check(&encoded, &field, &at, u16::MAX, num_points as f64);
        }
    }
}

/// Many vectors in either order give what each place gives alone, to the bit, whatever the others are:
/// in jittered lattices, in overlapping cells, on shared faces, edges and corners.
#[test]
fn many_places_are_sampled_as_each_alone() {
    for cut in CUTS {
        for (variant, doubled) in [(Variant::MultiLeaves, true), (Variant::MultiNodes, false)] {
            let mut random = Random(31);
            let mut soup = lattice(6, cut, 0.2, 17);
            if doubled {
                // The same again, a little aside: cells overlap, faces do not match.
                let again = lattice(5, Cut::Mixed, 0.1, 3).placed(1.1, [0.4; 3]);
                let first = soup.points.len() as u64;
                soup.points.extend(again.points);
                let moved = |c: Vec<u64>| c.iter().map(|v| v + first).collect();
                soup.cells
                    .extend(again.cells.into_iter().map(|(t, c)| (t, moved(c))));
            }
            let (encoded, field) = with_field(&soup, variant, 8);
            assert!(encoded.mesh.submeshes().len() > 1);
            let sampler = BlockSampler::new(&encoded.mesh, &field, None);
            let (mut at, mut lanes) = (Vec::new(), Vec::new());
            for vector in 0..150 {
                let middle = [0; 3].map(|_| random.between(0.0, 6.0));
                let mut places: Places = [[0.0; LANES]; 3];
                for lane in 0..LANES {
                    let corner = soup.points[random.next() as usize % soup.points.len()];
                    let other = soup.points[random.next() as usize % soup.points.len()];
                    for axis in 0..3 {
                        places[axis][lane] = match (vector + lane) % 7 {
                            0 => corner[axis],
                            1 => 0.5 * (corner[axis] + other[axis]),
                            _ => middle[axis] + random.between(-0.4, 0.4),
                        } as f32;
                    }
                }
                at.push(places);
                // Of some vectors few lanes, of some none.
                lanes.push((random.next() & random.next()) as u16 * u16::from(vector % 11 != 3));
            }
            let expected: Vec<Sampled> = at
                .iter()
                .zip(&lanes)
                .map(|(at, &lanes)| sampler.sample(at, lanes))
                .collect();
            let mut found = 0;
            for level in Level::available() {
                for order in [Order::Compact, Order::Scattered] {
                    let mut sampled = vec![Sampled::default(); at.len()];
                    sampler.sample_all_at(level, order, &at, &lanes, &mut sampled);
                    for (vector, (here, alone)) in sampled.iter().zip(&expected).enumerate() {
                        assert_eq!(bits(here), bits(alone), "{cut:?} {level:?} {order:?}");
                        assert_eq!(here.located.found & !lanes[vector], 0);
                        found += here.located.found.count_ones();
                    }
                }
            }
            assert!(found > 1000, "{found}");
        }
    }
}

/// What is found of a place in a batch that is sorted is what is found of it alone, in dense batches
/// and in sparse ones, with what is no place among them.
#[test]
fn sorted_batches_are_sampled_as_each_place_alone() {
    for cut in CUTS {
        let soup = lattice(6, cut, 0.25, 31);
        for (variant, vectors) in [
            (Variant::MultiNodes, 700),
            (Variant::MultiLeaves, 40),
            (Variant::Small, 120),
        ] {
            let (encoded, field) = with_field(&soup, variant, 9);
            let sampler = BlockSampler::new(&encoded.mesh, &field, None);
            let mut random = Random(vectors as u64);
            let (mut at, mut lanes) = (Vec::new(), Vec::new());
            for vector in 0..vectors {
                let mut places: Places =
                    [0; 3].map(|_| std::array::from_fn(|_| random.between(-1.0, 7.0) as f32));
                match vector % 9 {
                    0 => places[vector % 3][5] = f32::NAN,
                    1 => places[vector % 3][6] = f32::INFINITY,
                    2 => places[vector % 3][7] = f32::NEG_INFINITY,
                    3 => places[vector % 3][8] = -1e38,
                    // Sixteen times the same place, a vertex as likely as not.
                    4 => places = places.map(|c| [c[0].round(); LANES]),
                    _ => {}
                }
                at.push(places);
                lanes.push(random.next() as u16);
            }
            let mut alone = vec![Sampled::default(); vectors];
            for ((sampled, at), &lanes) in alone.iter_mut().zip(&at).zip(&lanes) {
                sampler.sample_all(
                    Order::Compact,
                    &[*at],
                    &[lanes],
                    std::slice::from_mut(sampled),
                );
            }
            let valid: u32 = alone.iter().map(|s| s.valid.count_ones()).sum();
            assert!(valid as usize > vectors, "{valid}");
            // What was there before is forgotten.
            let mut sampled = alone.clone();
            sampled.reverse();
            sampler.sample_all(Order::Scattered, &at, &lanes, &mut sampled);
            for (here, alone) in sampled.iter().zip(&alone) {
                assert_eq!(bits(here), bits(alone), "{cut:?} {variant:?}");
            }
            // The shortest list counts; no list is too short.
            let mut few = vec![Sampled::default(); 5];
            sampler.sample_all(Order::Scattered, &at, &lanes[..3], &mut few);
            assert_eq!(bits(&few[2]), bits(&alone[2]));
            assert_eq!(few[3].located.found, 0);
            sampler.sample_all(Order::Scattered, &[], &lanes, &mut few);
            sampler.sample_all(Order::Scattered, &at, &lanes, &mut []);
        }
    }
}

/// Gradients are those of the scalar code, the same on every instruction set.
#[test]
fn gradients_are_those_of_the_cells() {
    for cut in CUTS {
        let soup = lattice(6, cut, 0.15, 23);
        let (encoded, field) = with_field(&soup, Variant::MultiNodes, 9);
        let sampler = BlockSampler::new(&encoded.mesh, &field, None);
        let mut random = Random(6);
        let mut locator = encoded.mesh.locator();
        for _ in 0..20 {
            let at: Places =
                std::array::from_fn(|_| std::array::from_fn(|_| random.between(0.2, 5.8) as f32));
            let sampled = sampler.sample(&at, u16::MAX);
            let portable = sampler.gradients_at(Level::Baseline, &at, &sampled.located);
            for level in Level::available() {
                let here = sampler.gradients_at(level, &at, &sampled.located);
                let bits = |g: [[f32; LANES]; 3]| g.map(|axis| axis.map(f32::to_bits));
                assert_eq!(bits(here), bits(portable), "{level:?}");
            }
            for lane in (0..LANES).filter(|lane| sampled.located.found >> lane & 1 == 1) {
                let location = locator.locate_local(at.map(|c| f64::from(c[lane])));
                let location = location.expect("found");
                let cell = location.cell;
                let submesh = encoded.mesh.submesh(cell.submesh as usize).expect("there");
                let corners = submesh.corner_positions(&cell).expect("there");
                let first = submesh.header.first_vertex as usize;
                let values = cell
                    .corners
                    .map(|c| field.values().get_f64(first + c as usize, 0));
                let values = values.map(|v| v as f32);
                let expected = gradient_at(cell.cell_type, &corners, &values, &location.weights);
                let size = expected.iter().fold(1.0, |m, g| f64::max(m, g.abs()));
                for axis in 0..3 {
                    let off = f64::from(portable[axis][lane]) - expected[axis];
                    assert!(off.abs() < 1e-3 * size, "{cut:?}: {off} of {size}");
                }
            }
        }
    }
}
