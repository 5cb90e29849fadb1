//! Levels of detail: bounds hold for every cell type and variant, ranges are those of all boxes that
//! contain a place, and vectors give the bits of their scalar twin.

mod common;

use common::{CUTS, Cut, Random, Soup, lattice};
use proptest::prelude::*;
use vacua_pack::layout::{Child, WIDTH};
use vacua_pack::{
    DetailLevel, DetailSampler, EncodeOptions, Estimate, Estimates, PackedField, PackedMesh,
    PackedVolume, Places, Variant, encode,
};
use vacua_simd::{LANES, Level};
use vacua_volume::{Association, DataArray, ValueMap, ValueRange};

const VARIANTS: [Variant; 3] = [Variant::MultiLeaves, Variant::MultiNodes, Variant::Small];

/// A field that is smooth but for a few values that are no numbers.
fn packed(soup: &Soup, variant: Variant, association: Association, holes: bool) -> PackedVolume {
    let mesh = soup.mesh();
    // Sub-meshes of few vertices, so that there are many.
    let options = EncodeOptions {
        variant,
        index_bits: 8,
    };
    let encoded = encode(&mesh, options).expect("encodable");
    let n = match association {
        Association::Point => mesh.num_points(),
        Association::Cell => mesh.num_cells(),
    };
    let value = |i: usize| {
        if holes && i % 17 == 3 {
            f64::NAN
        } else {
            (0.01 * i as f64).sin() * 1e3 - 250.0
        }
    };
    let values = DataArray::from_vec((0..n).map(value).collect(), 1).expect("one column");
    let field = PackedField::pack(&encoded.mesh, &encoded.map, "f", association, &values);
    PackedVolume::new(encoded.mesh, field.expect("fits"))
}

/// The union of the ranges of all boxes of a level that contain a place, found without any tree.
fn brute_force(
    mesh: &PackedMesh,
    field: &PackedField,
    level: DetailLevel,
    at: [f64; 3],
) -> Option<ValueRange> {
    let mut found: Option<ValueRange> = None;
    let mut join = |range: Option<ValueRange>| {
        if let Some(range) = range {
            found = Some(found.map_or(range, |f| f.union(range)));
        }
    };
    let within =
        |lo: [f64; 3], p: [f64; 3], hi: [f64; 3]| (0..3).all(|a| lo[a] <= p[a] && p[a] <= hi[a]);
    for number in 0..mesh.submeshes().len() {
        let submesh = mesh.submesh(number).expect("there");
        let header = submesh.header;
        let of_header = within(header.lo.map(f64::from), at, header.hi.map(f64::from));
        if level == DetailLevel::Submesh {
            join(field.submesh_range(number).filter(|_| of_header));
            continue;
        }
        let place = submesh.grid.grid_from_local(at).map(|g| 16.0 * g);
        for node_number in 0..header.num_nodes {
            let (node, _) = submesh.node(node_number).expect("there");
            let own = [node.lo, node.hi].map(|c| {
                submesh
                    .grid
                    .local_from_sixteenths(c.map(|q| 16 * u32::from(q)))
            });
            let entered = match mesh.variant() {
                Variant::MultiLeaves => within(own[0], at, own[1]),
                _ => of_header,
            };
            if !entered {
                continue;
            }
            let leaves = (0..WIDTH).filter(|&k| matches!(node.child(k), Child::Leaf(_)));
            let boxes: Vec<_> = leaves
                .map(|k| {
                    let (lo, hi) = node.child_box(k);
                    let range = field.child_range(mesh, number, node_number, k);
                    (lo.map(f64::from), hi.map(f64::from), range)
                })
                .collect();
            if level == DetailLevel::Leaf {
                for &(lo, hi, range) in &boxes {
                    join(range.filter(|_| within(lo, place, hi)));
                }
                continue;
            }
            let Some(&(mut lo, mut hi, _)) = boxes.first() else {
                continue;
            };
            let mut ranges = Vec::new();
            for (l, h, range) in &boxes {
                lo = [0, 1, 2].map(|a| lo[a].min(l[a]));
                hi = [0, 1, 2].map(|a| hi[a].max(h[a]));
                ranges.extend(*range);
            }
            if within(lo, place, hi) {
                join(ranges.into_iter().reduce(ValueRange::union));
            }
        }
    }
    found
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn no_value_is_farther_off_than_the_bound(
        n in 1usize..6,
        cut in 0usize..5,
        variant in 0usize..3,
        jitter in prop_oneof![Just(0.0), 0.0f64..0.45],
        scale in prop::sample::select(vec![1e-9, 1.0, 1e7]),
        seed in any::<u64>(),
        on_cells in any::<bool>(),
        holes in any::<bool>(),
    ) {
        let soup = lattice(n, CUTS[cut], jitter, seed).placed(scale, [3.0 * scale, 0.0, -scale]);
        let association = if on_cells { Association::Cell } else { Association::Point };
        let volume = packed(&soup, VARIANTS[variant], association, holes);
        let (mesh, field) = (volume.mesh(), volume.field());
        let origin = mesh.origin();
        let mut random = Random(seed ^ 1);
        let mut locator = mesh.locator();
        let samplers = DetailLevel::ALL
            .map(|level| DetailSampler::new(mesh, field, level, ValueMap::IDENTITY));
        let bounds = volume.bounds();
        let mut inside = 0;
        for i in 0..60 {
            let from = [0, 1, 2].map(|a| random.between(-0.1, 1.1) * bounds.size()[a]);
            let corner = soup.points[(random.next() % soup.points.len() as u64) as usize];
            // Anywhere, and on vertices, where boxes end.
            let at = [0, 1, 2].map(|a| match i % 3 {
                0 => f64::from(corner[a] as f32) - origin[a],
                _ => bounds.lo[a] - origin[a] + from[a],
            });
            let exact = locator
                .locate_local(at)
                .and_then(|location| field.value_at(mesh, &location));
            let mut coarser: Option<ValueRange> = None;
            for (sampler, level) in samplers.iter().zip(DetailLevel::ALL) {
                let range = sampler.range_at(at);
                prop_assert_eq!(range, brute_force(mesh, field, level, at), "{:?}", level);
                if let Some(exact) = exact {
                    inside += 1;
                    let estimate = Estimate::from(range.expect("a cell has a box"));
                    prop_assert!((estimate.value - exact).abs() <= estimate.bound, "{:?}", level);
                }
                if let (Some(range), Some(coarser)) = (range, coarser) {
                    prop_assert!(coarser.lo <= range.lo && range.hi <= coarser.hi);
                }
                coarser = range;
            }
        }
        prop_assert!(inside > 0 || holes);
    }

    #[test]
    fn vectors_give_the_bits_of_their_twin(
        cut in 0usize..5,
        variant in 0usize..3,
        jitter in 0.0f64..0.45,
        shift in prop::sample::select(vec![0.0, 1e3, 1e6]),
        seed in any::<u64>(),
        spread in prop::sample::select(vec![0.0, 0.01, 0.3, 6.0]),
    ) {
        let soup = lattice(5, CUTS[cut], jitter, seed).placed(1.0, [shift; 3]);
        let volume = packed(&soup, VARIANTS[variant], Association::Point, true);
        let (mesh, field) = (volume.mesh(), volume.field());
        let range = field.submesh_range(0).expect("values");
        let map = ValueMap::for_range(field.values().scalar_type(), range);
        let origin = mesh.origin();
        let mut random = Random(seed ^ 2);
        let mut at: Vec<Places> = Vec::new();
        for _ in 0..8 {
            let middle = [0, 1, 2].map(|a| shift - origin[a] + random.between(-0.2, 5.2));
            let mut places = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                for a in 0..3 {
                    places[a][lane] = (middle[a] + random.between(-spread, spread)) as f32;
                }
            }
            at.push(places);
        }
        at[0][0][5] = f32::NAN;
        at[1][2][7] = f32::INFINITY;
        let lanes: Vec<u16> = at.iter().map(|_| random.next() as u16 | 0xA0).collect();
        for level in DetailLevel::ALL {
            let sampler = DetailSampler::new(mesh, field, level, map);
            for simd in [Level::Baseline, Level::best()] {
                let mut found = vec![Estimates::default(); at.len()];
                sampler.sample_all_at(simd, &at, &lanes, &mut found);
                for ((places, lanes), found) in at.iter().zip(&lanes).zip(&found) {
                    for lane in 0..LANES {
                        let twin = sampler.rendered_at([0, 1, 2].map(|a| places[a][lane]));
                        let twin = twin.filter(|_| lanes >> lane & 1 == 1);
                        prop_assert_eq!(found.valid >> lane & 1 == 1, twin.is_some());
                        let bits = twin.unwrap_or(0.0).to_bits();
                        prop_assert_eq!(found.values[lane].to_bits(), bits);
                    }
                }
            }
        }
    }
}

#[test]
fn nothing_is_where_no_box_is() {
    for variant in VARIANTS {
        let soup = lattice(3, Cut::Tetrahedra, 0.2, 9);
        let volume = packed(&soup, variant, Association::Point, false);
        for level in DetailLevel::ALL {
            let points = [[-9.0, 1.0, 1.0], [1.0, 99.0, 1.0], [f64::NAN, 1.0, 1.0]];
            let points = points.map(glam::DVec3::from);
            assert_eq!(volume.estimates_at(level, &points), [None; 3]);
        }
    }
}

#[test]
fn finer_levels_are_closer() {
    let soup = lattice(8, Cut::Tetrahedra, 0.3, 4);
    let mesh = soup.mesh();
    let encoded = encode(&mesh, EncodeOptions::default()).expect("encodable");
    let heights: Vec<f64> = soup.points.iter().map(|p| p[2]).collect();
    let heights = DataArray::from_vec(heights, 1).expect("one column");
    let association = Association::Point;
    let field = PackedField::pack(&encoded.mesh, &encoded.map, "z", association, &heights);
    let volume = PackedVolume::new(encoded.mesh, field.expect("fits"));
    let mut random = Random(1);
    let points: Vec<glam::DVec3> = (0..500)
        .map(|_| glam::DVec3::from([0; 3].map(|_| random.between(1.0, 7.0))))
        .collect();
    let mean = DetailLevel::ALL.map(|level| {
        let estimates = volume.estimates_at(level, &points);
        let bounds = estimates.iter().map(|e| e.expect("inside").bound);
        bounds.sum::<f64>() / points.len() as f64
    });
    // One sub-mesh over all of the cube; leaves of a few cells.
    assert!((mean[0] - 4.0).abs() < 0.5, "{mean:?}");
    assert!(
        mean[1] < 0.7 * mean[0] && mean[2] < 0.7 * mean[1],
        "{mean:?}"
    );
}
