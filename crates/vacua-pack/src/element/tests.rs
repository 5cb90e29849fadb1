use super::*;
use proptest::prelude::*;

/// Corners of the reference elements, VTK's order.
fn reference(cell_type: CellType) -> Vec<[f64; 3]> {
    let quad = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, z], [0.0, 1.0, z]];
    let triangle = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
    match cell_type {
        CellType::Tetrahedron => [&triangle(0.0)[..], &[[0.0, 0.0, 1.0]]].concat(),
        CellType::Pyramid => [&quad(0.0)[..], &[[0.5, 0.5, 1.0]]].concat(),
        CellType::Wedge => [triangle(0.0), triangle(1.0)].concat(),
        CellType::Hexahedron => [quad(0.0), quad(1.0)].concat(),
    }
}

pub(super) fn moved(
    cell_type: CellType,
    jitter: &[[f64; 3]],
    scale: f64,
    shift: [f64; 3],
) -> [[f32; 3]; 8] {
    let mut corners = [[0.0; 3]; 8];
    for (k, c) in reference(cell_type).iter().enumerate() {
        corners[k] = [0, 1, 2].map(|i| (scale * (c[i] + jitter[k][i] + shift[i])) as f32);
    }
    corners
}

pub(super) fn jitter(amplitude: f64) -> impl Strategy<Value = Vec<[f64; 3]>> {
    prop::collection::vec(prop::array::uniform3(-amplitude..amplitude), 8)
}

fn cell_type() -> impl Strategy<Value = CellType> {
    prop::sample::select(CellType::ALL.to_vec())
}

fn blend(weights: &[f64], corners: &[[f32; 3]; 8]) -> [f64; 3] {
    [0, 1, 2].map(|i| {
        let terms = weights.iter().zip(corners);
        terms.map(|(w, c)| w * f64::from(c[i])).sum()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// A place made from weights of the element is accepted, and its weights give it back.
    #[test]
    fn places_inside_are_accepted_and_come_back(
        cell_type in cell_type(),
        jitter in jitter(0.15),
        local in prop::array::uniform3(0.0f64..=1.0),
        power in -9i32..=9,
        shift in prop::array::uniform3(-3.0f64..3.0),
    ) {
        let scale = 10f64.powi(power);
        let corners = moved(cell_type, &jitter, scale, shift);
        let [mut r, mut s, t] = local;
        if matches!(cell_type, CellType::Tetrahedron | CellType::Wedge) && r + s > 1.0 {
            (r, s) = (1.0 - r, 1.0 - s);
        }
        let w = match cell_type {
            CellType::Tetrahedron => {
                let u = 1.0 - t;
                vec![u * (1.0 - r - s), u * r, u * s, t]
            }
            CellType::Pyramid => {
                let u = 1.0 - t;
                vec![u*(1.0-r)*(1.0-s), u*r*(1.0-s), u*r*s, u*(1.0-r)*s, t]
            }
            CellType::Wedge => {
                let (q, u) = (1.0 - r - s, 1.0 - t);
                vec![q*u, r*u, s*u, q*t, r*t, s*t]
            }
            CellType::Hexahedron => {
                let (q, u, v) = (1.0 - r, 1.0 - s, 1.0 - t);
                vec![q*u*v, r*u*v, r*s*v, q*s*v, q*u*t, r*u*t, r*s*t, q*s*t]
            }
        };
        let p = blend(&w, &corners);
        let found = weights_at(cell_type, &corners, p);
        // On the very face of the box, rounding of `p` may put it outside.
        let deep = w.iter().all(|&w| w > 1e-12);
        prop_assert!(found.is_some() || !deep, "{:?} {:?}", cell_type, w);
        if let Some(found) = found {
            let n = cell_type.num_points();
            prop_assert!(found.iter().all(|&w| (0.0..=1.0).contains(&w)));
            prop_assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            prop_assert!(found[n..].iter().all(|&w| w == 0.0));
            let back = blend(&found, &corners);
            for i in 0..3 {
                prop_assert!((back[i] - p[i]).abs() <= 1e-8 * scale, "{back:?} {p:?}");
            }
        }
    }

    /// Scaling by a power of two changes no weight's bits.
    #[test]
    fn answers_have_no_unit(
        cell_type in cell_type(),
        jitter in jitter(0.2),
        place in prop::array::uniform3(-0.2f64..1.2),
        power in -60i32..60,
    ) {
        let here = moved(cell_type, &jitter, 1.0, [0.0; 3]);
        let factor = 2f64.powi(power);
        let there = here.map(|c| c.map(|x| (f64::from(x) * factor) as f32));
        prop_assert_eq!(
            weights_at(cell_type, &here, place),
            weights_at(cell_type, &there, place.map(|x| x * factor))
        );
    }

    /// Every point of a common face is accepted by at least one of its two tetrahedra.
    #[test]
    fn faces_leave_no_gap(
        corners in prop::collection::vec(prop::array::uniform3(-1.0f32..1.0), 5),
        a in 0.0f64..1.0,
        b in 0.0f64..1.0,
        flatten in prop::sample::select(vec![1.0f32, 1e-3, 1e-6]),
    ) {
        let c: Vec<[f32; 3]> = corners.iter().map(|p| [p[0], p[1], flatten * p[2]]).collect();
        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        let first = [c[0], c[1], c[2], c[3], c[3], c[3], c[3], c[3]];
        let mut second = first;
        second[3] = c[4];
        let p = blend(&[1.0 - a - b, a, b], &first);
        let volume = |t: &[[f32; 3]; 8]| {
            let d = [1, 2, 3].map(|k| [0, 1, 2].map(|i| f64::from(t[k][i]) - f64::from(t[0][i])));
            linear::dot(d[0], linear::cross(d[1], d[2]))
        };
        let (v, w) = (volume(&first), volume(&second));
        // The two lie on different sides of the face.
        if v * w < 0.0 && v.abs().min(w.abs()) > 1e-12 {
            let found = [first, second].map(|t| weights_at(CellType::Tetrahedron, &t, p).is_some());
            prop_assert!(found[0] || found[1]);
        }
    }

    #[test]
    fn interpolation_stays_within_the_values(
        values in prop::collection::vec(-1e30f64..1e30, 4),
        w in prop::collection::vec(0.0f64..1.0, 4),
    ) {
        let sum: f64 = w.iter().sum::<f64>() + 1e-300;
        let mut weights = [0.0; 8];
        (0..4).for_each(|i| weights[i] = w[i] / sum);
        let v = interpolate(&weights, &values).expect("finite");
        prop_assert!(values.iter().any(|&x| x <= v) && values.iter().any(|&x| x >= v));
    }
}

#[test]
fn corners_are_their_own() {
    for cell_type in CellType::ALL {
        let none = vec![[0.0; 3]; 8];
        let corners = moved(cell_type, &none, 1.0, [0.0; 3]);
        for k in 0..cell_type.num_points() {
            let p = corners[k].map(f64::from);
            let w = weights_at(cell_type, &corners, p).expect("a corner is inside");
            assert!((w[k] - 1.0).abs() < 1e-12, "{cell_type:?} {k} {w:?}");
        }
    }
}

#[test]
fn flat_cells_accept_nothing_and_inverted_ones_do() {
    for cell_type in CellType::ALL {
        let none = vec![[0.0; 3]; 8];
        let mut corners = moved(cell_type, &none, 1.0, [0.0; 3]);
        let p = [0.3, 0.3, 0.2];
        assert!(weights_at(cell_type, &corners, p).is_some());
        corners.iter_mut().for_each(|c| c[2] = 1.0 - c[2]);
        assert!(weights_at(cell_type, &corners, [0.3, 0.3, 0.8]).is_some());
        corners.iter_mut().for_each(|c| c[2] = 0.0);
        assert_eq!(weights_at(cell_type, &corners, [0.3, 0.3, 0.0]), None);
    }
}

#[test]
fn values_that_are_no_numbers_give_none() {
    let weights = [0.25, 0.25, 0.25, 0.25, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(interpolate(&weights, &[1.0, f64::NAN, 1.0, 1.0]), None);
    assert_eq!(interpolate(&weights, &[]), None);
    assert_eq!(interpolate(&weights, &[0.1; 4]), Some(0.1));
}
