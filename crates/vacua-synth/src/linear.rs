//! Linear fields on uniform, stretched and bent grids: every interpolation must reproduce them.

use glam::DVec3;
use vacua_volume::{CurvilinearGrid, DataArray, Dataset, Geometry, RectilinearGrid, UniformGrid};

use crate::fill::{fill_f64, unit_scale, zeros};
use crate::kind::{Kind, Spec, SynthError, dataset};

/// How far the top of the twisted box is turned against its bottom, in radians.
const TWIST: f64 = 1.0;

/// How much of a turn the pipe makes, in radians.
const PIPE: f64 = 1.5 * std::f64::consts::PI;

/// Part of the values' span that x, y and z contribute.
const SHARES: DVec3 = DVec3::new(0.5, 0.3, 0.2);

/// The analytic value of a linear field: `offset + gradient · position`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearField {
    /// Change of value per world length.
    pub gradient: DVec3,
    /// Value at the origin of the world.
    pub offset: f64,
}

impl LinearField {
    /// The field that a linear kind samples, before rounding to the stored type: 0 at the lower
    /// corner of the bounds and [`unit_scale`] at the upper; `None` for other kinds.
    ///
    /// # Errors
    /// As [`crate::generate`].
    pub fn of(spec: &Spec) -> Result<Option<Self>, SynthError> {
        let scale = unit_scale(spec.scalar_type);
        Ok(geometry(spec)?.map(|geometry| Self::spanning(&geometry, scale)))
    }

    fn spanning(geometry: &Geometry, scale: f64) -> Self {
        let bounds = geometry.bounds();
        let gradient = scale * SHARES / bounds.size();
        Self {
            gradient,
            offset: -gradient.dot(bounds.lo),
        }
    }

    /// The value at a point in the world.
    pub fn value(&self, position_world: DVec3) -> f64 {
        self.offset + self.gradient.dot(position_world)
    }
}

/// Makes one of the linear kinds.
pub(crate) fn generate(spec: &Spec) -> Result<Dataset, SynthError> {
    let geometry = geometry(spec)?.ok_or(SynthError::TooSmall {
        points: spec.points,
    })?;
    let field = LinearField::spanning(&geometry, unit_scale(spec.scalar_type));
    let [nx, ny, _] = spec.points;
    let values = fill_f64(spec.points, spec.scalar_type, |[x, y, z]| {
        let position = match &geometry {
            Geometry::Uniform(grid) => grid
                .world_from_index()
                .transform_point3(DVec3::new(x as f64, y as f64, z as f64)),
            Geometry::Rectilinear(grid) => DVec3::new(
                grid.coordinates(0)[x],
                grid.coordinates(1)[y],
                grid.coordinates(2)[z],
            ),
            Geometry::Curvilinear(grid) => grid.position(x + nx * (y + ny * z)),
            Geometry::Unstructured(mesh) => mesh.position(x + nx * (y + ny * z)),
        };
        field.value(position)
    })?;
    dataset(geometry, values)
}

/// The grid of a linear kind; `None` for other kinds.
fn geometry(spec: &Spec) -> Result<Option<Geometry>, SynthError> {
    let points = spec.points;
    crate::fill::num_points(points)?;
    let geometry = match spec.kind {
        Kind::Linear => Geometry::Uniform(UniformGrid::new(
            points,
            DVec3::new(-3.0, 2.0, 5.0),
            DVec3::new(1.0, 1.5, 0.75),
        )?),
        Kind::LinearRectilinear => {
            let [x, y, z] = points.map(|n| {
                let last = (n - 1) as f64;
                (0..n)
                    .map(|i| i as f64 * (0.25 + 1.5 * i as f64 / last))
                    .collect()
            });
            Geometry::Rectilinear(RectilinearGrid::new(x, y, z)?)
        }
        Kind::LinearTwist => bent(points, |u| {
            let (sin, cos) = (libm::sin(TWIST * u.z), libm::cos(TWIST * u.z));
            let (x, y) = (u.x - 0.5, u.y - 0.5);
            DVec3::new(cos * x - sin * y, sin * x + cos * y, u.z)
        })?,
        Kind::LinearAnnulus => bent(points, |u| {
            let (radius, angle) = (1.0 + u.x, PIPE * u.y);
            DVec3::new(radius * libm::cos(angle), radius * libm::sin(angle), u.z)
        })?,
        _ => return Ok(None),
    };
    Ok(Some(geometry))
}

/// A lattice on the unit cube, moved by a map; about one world unit a cell.
fn bent(points: [usize; 3], map: impl Fn(DVec3) -> DVec3) -> Result<Geometry, SynthError> {
    let mut positions = Vec::new();
    drop(zeros::<f64>([
        points[0].saturating_mul(3),
        points[1],
        points[2],
    ])?);
    let last = DVec3::from_array(points.map(|n| (n - 1) as f64));
    positions.reserve(points.iter().product::<usize>() * 3);
    for z in 0..points[2] {
        for y in 0..points[1] {
            for x in 0..points[0] {
                let unit = DVec3::new(x as f64, y as f64, z as f64) / last;
                positions.extend((map(unit) * last.max_element()).to_array());
            }
        }
    }
    let positions = DataArray::from_vec(positions, 3)?;
    Ok(Geometry::Curvilinear(CurvilinearGrid::new(
        points, positions,
    )?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vacua_volume::ScalarType;

    const KINDS: [Kind; 4] = [
        Kind::Linear,
        Kind::LinearRectilinear,
        Kind::LinearTwist,
        Kind::LinearAnnulus,
    ];

    #[test]
    fn points_hold_the_analytic_value() {
        for kind in KINDS {
            for scalar_type in [ScalarType::F64, ScalarType::F32, ScalarType::U16] {
                let spec = Spec::new(kind)
                    .with_points([7, 9, 5])
                    .with_type(scalar_type);
                let made = generate(&spec).expect("small");
                let field = LinearField::of(&spec).expect("small").expect("linear");
                let values = made.fields()[0].load().expect("in memory");
                let bounds = made.geometry().bounds();
                assert!(field.value(bounds.lo).abs() < 1e-9);
                let scale = unit_scale(scalar_type);
                assert!((field.value(bounds.hi) - scale).abs() < 1e-9 * scale);
                let tolerance = match scalar_type {
                    ScalarType::U16 => 0.5,
                    ScalarType::F32 => f64::from(f32::EPSILON) / 2.0,
                    _ => 0.0,
                };
                if let Geometry::Curvilinear(grid) = &**made.geometry() {
                    for point in 0..values.tuples() {
                        let expected = field.value(grid.position(point));
                        assert!((values.get_f64(point, 0) - expected).abs() <= tolerance);
                    }
                }
            }
        }
        let other = Spec::new(Kind::Shells);
        assert_eq!(LinearField::of(&other).expect("no grid is made"), None);
    }

    #[test]
    fn bent_cells_keep_their_orientation() {
        for kind in [Kind::LinearTwist, Kind::LinearAnnulus] {
            let made = generate(&Spec::new(kind).with_points([8, 16, 6])).expect("small");
            let Geometry::Curvilinear(grid) = &**made.geometry() else {
                panic!("{kind} is curvilinear")
            };
            let at = |x: usize, y: usize, z: usize| grid.position(x + 8 * (y + 16 * z));
            for (x, y, z) in [(0, 0, 0), (3, 7, 2), (6, 14, 4)] {
                let o = at(x, y, z);
                let volume = (at(x + 1, y, z) - o)
                    .cross(at(x, y + 1, z) - o)
                    .dot(at(x, y, z + 1) - o);
                assert!(volume > 0.0, "{kind}");
            }
        }
    }
}
