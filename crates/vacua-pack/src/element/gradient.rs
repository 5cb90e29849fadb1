//! The gradient of what an element interpolates.

use vacua_volume::CellType;

use super::Weights;
use super::linear::{Vec3, cross, dot, sub};

/// The gradient in space of the values at a cell's corners, where the corners have some weights (as
/// [`super::weights_at`] gives them); 0 where the cell's map is singular.
pub fn gradient_at(
    cell_type: CellType,
    corners: &[[f32; 3]; 8],
    values: &[f32; 8],
    weights: &Weights,
) -> [f64; 3] {
    let slopes = slopes(cell_type, weights);
    let first = corners[0].map(f64::from);
    let mut columns = [[0.0; 3]; 3];
    let mut by = [0.0; 3];
    for k in 0..cell_type.num_points() {
        // Differences to the first corner: the slopes of all corners are 0 in sum.
        let from_first = sub(corners[k].map(f64::from), first);
        let value = f64::from(values[k]) - f64::from(values[0]);
        for (axis, slopes) in slopes.iter().enumerate() {
            by[axis] += slopes[k] * value;
            for i in 0..3 {
                columns[axis][i] += slopes[k] * from_first[i];
            }
        }
    }
    let [a, b, c] = columns;
    let (bc, ca, ab) = (cross(b, c), cross(c, a), cross(a, b));
    let determinant = dot(a, bc);
    let gradient: Vec3 =
        [0, 1, 2].map(|i| (by[0] * bc[i] + by[1] * ca[i] + by[2] * ab[i]) / determinant);
    if gradient.iter().all(|g| g.is_finite()) {
        gradient
    } else {
        [0.0; 3]
    }
}

/// How the corners' weights change with each local coordinate.
fn slopes(cell_type: CellType, w: &Weights) -> [Weights; 3] {
    match cell_type {
        CellType::Tetrahedron => {
            let mut slopes = [[0.0; 8]; 3];
            for (axis, slopes) in slopes.iter_mut().enumerate() {
                (slopes[0], slopes[axis + 1]) = (-1.0, 1.0);
            }
            slopes
        }
        CellType::Pyramid => {
            let height = (w[0] + w[1] + w[2] + w[3]).max(f64::MIN_POSITIVE);
            let (r, s) = ((w[1] + w[2]) / height, (w[2] + w[3]) / height);
            let (q, u) = (1.0 - r, 1.0 - s);
            // By r and s per unit of height, by which the columns are then scaled alike.
            [
                [-u, u, s, -s, 0.0, 0.0, 0.0, 0.0],
                [-q, -r, r, q, 0.0, 0.0, 0.0, 0.0],
                [-q * u, -r * u, -r * s, -q * s, 1.0, 0.0, 0.0, 0.0],
            ]
        }
        CellType::Wedge => {
            let t = w[3] + w[4] + w[5];
            let (r, s, u) = (w[1] + w[4], w[2] + w[5], 1.0 - t);
            let q = 1.0 - r - s;
            [
                [-u, u, 0.0, -t, t, 0.0, 0.0, 0.0],
                [-u, 0.0, u, -t, 0.0, t, 0.0, 0.0],
                [-q, -r, -s, q, r, s, 0.0, 0.0],
            ]
        }
        CellType::Hexahedron => {
            let r = w[1] + w[2] + w[5] + w[6];
            let s = w[2] + w[3] + w[6] + w[7];
            let t = w[4] + w[5] + w[6] + w[7];
            let (q, u, v) = (1.0 - r, 1.0 - s, 1.0 - t);
            [
                [-u * v, u * v, s * v, -s * v, -u * t, u * t, s * t, -s * t],
                [-q * v, -r * v, r * v, q * v, -q * t, -r * t, r * t, q * t],
                [-q * u, -r * u, -r * s, -q * s, q * u, r * u, r * s, q * s],
            ]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{jitter, moved};
    use super::super::weights_at;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A linear function has its slope everywhere, in every element.
        #[test]
        fn linear_functions_have_their_slope(
            cell_type in prop::sample::select(CellType::ALL.to_vec()),
            jitter in jitter(0.15),
            place in prop::array::uniform3(0.0f64..1.0),
            slope in prop::array::uniform3(-2.0f64..2.0),
        ) {
            let corners = moved(cell_type, &jitter, 1.0, [0.3, -0.2, 0.1]);
            let place = [place[0] + 0.3, place[1] - 0.2, place[2] + 0.1];
            if let Some(weights) = weights_at(cell_type, &corners, place) {
                let values = corners.map(|c| dot(slope, c.map(f64::from)) as f32);
                let found = gradient_at(cell_type, &corners, &values, &weights);
                for i in 0..3 {
                    prop_assert!((found[i] - slope[i]).abs() < 1e-4, "{found:?} {slope:?}");
                }
            }
        }
    }

    #[test]
    fn flat_cells_have_none() {
        let corners = [[1.0; 3]; 8];
        let values = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        for cell_type in CellType::ALL {
            let weights = [0.125; 8];
            assert_eq!(
                gradient_at(cell_type, &corners, &values, &weights),
                [0.0; 3]
            );
        }
    }
}
