//! `ImageData`: a uniform grid whose arrays are boxes, z slowest, with a step before it where there
//! are steps.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};
use vacua_volume::{Association, DataArray, Dataset, Field, Geometry, LoadError, UniformGrid};

use super::arrays::{StepArray, StepArrays};
use super::steps::Steps;
use crate::error::Problem;
use crate::hdf5::Container;
use crate::vtk::extent::Extent;
use crate::vtk::ghost;

/// Reads the grid in a group.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(super) fn read(file: &Container, data_set: &str, step: usize) -> Result<Dataset, Problem> {
    let steps = Steps::read(file, data_set)?;
    steps.check(step)?;
    let extent = extent(file, data_set)?;
    extent.refuse_flat()?;
    let points = extent.points();
    let grid = UniformGrid::with_affine(points, world_from_index(file, data_set, &extent)?)?;
    let mut notes = Vec::new();
    let arrays = StepArrays::list(file, data_set, &steps, step, &mut notes)?;
    let has_steps = !steps.times.is_empty();
    let place = |array: &StepArray| -> Result<Placed, Problem> {
        Placed::new(array, &extent, has_steps, array.offset.unwrap_or(step))
    };
    let flags = |array: &Option<StepArray>| -> Result<Option<DataArray>, Problem> {
        array.as_ref().map(|a| place(a)?.read(a)).transpose()
    };
    let [point_flags, cell_flags] = [flags(&arrays.flags[0])?, flags(&arrays.flags[1])?];
    let mask = ghost::blanked_cells(points, point_flags.as_ref(), cell_flags.as_ref())?;
    let mut fields = Vec::with_capacity(arrays.fields.len());
    for array in arrays.fields {
        let placed = place(&array)?;
        fields.push(Field::lazy(
            array.name.clone(),
            array.association,
            array.array.scalar_type()?,
            placed.components,
            placed.tuples,
            move || {
                placed
                    .read(&array)
                    .map_err(|problem| Arc::new(problem) as LoadError)
            },
        ));
    }
    let mut dataset = Dataset::new(Geometry::Uniform(grid), fields)?;
    if let Some(mask) = mask {
        dataset = dataset.with_blanked_cells(mask)?;
    }
    let dataset = dataset.with_times(steps.times, step);
    Ok(notes.into_iter().fold(dataset, Dataset::with_note))
}

/// Numbers of an attribute, if there are any.
fn attribute<const N: usize>(
    file: &Container,
    data_set: &str,
    name: &str,
) -> Result<Option<[f64; N]>, Problem> {
    let Some(numbers) = file.numbers(data_set, name)? else {
        return Ok(None);
    };
    let found = numbers.len();
    numbers.try_into().map(Some).map_err(|_| {
        Problem::malformed(
            format!("attribute `{name}` of group `{data_set}`"),
            format!("{N} numbers"),
            found.to_string(),
        )
    })
}

fn extent(file: &Container, data_set: &str) -> Result<Extent, Problem> {
    let wrong = |found: String| {
        Problem::malformed(
            format!("attribute `WholeExtent` of group `{data_set}`"),
            "six 32-bit integers",
            found,
        )
    };
    let numbers: [f64; 6] =
        attribute(file, data_set, "WholeExtent")?.ok_or_else(|| wrong("none".to_owned()))?;
    let limits = f64::from(i32::MIN)..=f64::from(i32::MAX);
    if !numbers
        .iter()
        .all(|n| limits.contains(n) && n.fract() == 0.0)
    {
        return Err(wrong(format!("{numbers:?}")));
    }
    let [x0, x1, y0, y1, z0, z1] = numbers.map(|n| n as i64);
    Ok(Extent {
        lo: [x0, y0, z0],
        hi: [x1, y1, z1],
    })
}

fn world_from_index(
    file: &Container,
    data_set: &str,
    extent: &Extent,
) -> Result<DAffine3, Problem> {
    let origin = attribute::<3>(file, data_set, "Origin")?.unwrap_or([0.0; 3]);
    let spacing = attribute::<3>(file, data_set, "Spacing")?.unwrap_or([1.0; 3]);
    let rows =
        attribute::<9>(file, data_set, "Direction")?.unwrap_or(DMat3::IDENTITY.to_cols_array());
    let axes = DMat3::from_cols_array(&rows).transpose()
        * DMat3::from_diagonal(DVec3::from_array(spacing));
    let mut affine = DAffine3::from_mat3_translation(axes, DVec3::from_array(origin));
    affine.translation = affine.transform_point3(DVec3::from_array(extent.lo.map(|i| i as f64)));
    Ok(affine)
}

/// The part of an array that belongs to a step.
#[derive(Clone, Copy)]
struct Placed {
    first: usize,
    components: usize,
    tuples: usize,
}

impl Placed {
    fn new(
        array: &StepArray,
        extent: &Extent,
        has_steps: bool,
        step: usize,
    ) -> Result<Self, Problem> {
        let [nx, ny, nz] = extent.size(array.association);
        let tuples = extent.count(array.association)?;
        let lens = array.array.lens();
        let (steps, lens) = match (has_steps, lens) {
            (true, [steps, lens @ ..]) => (*steps, lens),
            (_, lens) => (1, lens),
        };
        let step = if has_steps { step } else { 0 };
        let components = match lens {
            [z, y, x] if [*z, *y, *x] == [nz, ny, nx] => Some(1),
            [z, y, x, rest @ ..] if [*z, *y, *x] == [nz, ny, nx] => Some(rest.iter().product()),
            _ => None,
        };
        let components = components
            .filter(|&c| c > 0 && step < steps)
            .ok_or_else(|| {
                let kind = match array.association {
                    Association::Point => "points",
                    Association::Cell => "cells",
                };
                Problem::malformed(
                    array.array.what(),
                    format!("a box of {nz} × {ny} × {nx} {kind} for step {step}"),
                    format!("{:?}", array.array.lens()),
                )
            })?;
        Ok(Self {
            first: step.saturating_mul(tuples).saturating_mul(components),
            components,
            tuples,
        })
    }

    fn read(&self, array: &StepArray) -> Result<DataArray, Problem> {
        array.array.read(self.first, self.components, self.tuples)
    }
}
