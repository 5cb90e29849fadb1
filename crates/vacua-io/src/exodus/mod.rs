//! Exodus II: meshes of several blocks with time steps, in NetCDF classic files and (through
//! [`crate::hdf5`]) in NetCDF-4 files.
//!
//! Source: *EXODUS: A Finite Element Data Model*, Sandia National Laboratories, SAND2019-1723; names
//! of variables as in its appendix A. Displacements are fields like others and are not applied. Three
//! variables whose names end in X, Y, Z (or x, y, z) are one vector. A variable that a block lacks is
//! not a number there. Faces of side sets are cells below three dimensions: counted, left out.

mod blocks;
mod fields;

use std::borrow::Cow;
use std::sync::Arc;

use glam::DVec3;
use vacua_volume::{DataArray, Dataset};

use crate::error::Problem;
use crate::mesh::{Ends, Part, SourceCells, assemble, join};
use crate::netcdf::{Classic, Shape, is_classic};
use crate::registry::{Format, ReadOptions};
use crate::source::Source;

/// The Exodus II format.
pub(crate) const FORMAT: Format = Format {
    name: "Exodus II",
    extensions: &["ex2", "exo", "e", "exii", "g", "gen"],
    sniff: Some(is_classic),
    read,
};

/// What an Exodus file is made of, whatever the container.
pub(crate) trait Variables: Send + Sync {
    /// The length of a dimension.
    fn dimension(&self, name: &str) -> Option<usize>;
    /// What a variable looks like.
    fn shape(&self, name: &str) -> Option<Shape>;
    /// A text attribute of a variable.
    fn text_of(&self, variable: &str, attribute: &str) -> Option<String>;
    /// `tuples × components` numbers from number `first` of a record, or of the whole.
    fn numbers(
        &self,
        name: &str,
        record: usize,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem>;
    /// A list of texts.
    fn texts(&self, name: &str) -> Result<Vec<String>, Problem>;
}

impl Variables for Classic {
    fn dimension(&self, name: &str) -> Option<usize> {
        self.dimension(name)
    }

    fn shape(&self, name: &str) -> Option<Shape> {
        self.shape(name)
    }

    fn text_of(&self, variable: &str, attribute: &str) -> Option<String> {
        self.text_of(variable, attribute).map(str::to_owned)
    }

    fn numbers(
        &self,
        name: &str,
        record: usize,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem> {
        self.numbers(name, record, first, components, tuples)
    }

    fn texts(&self, name: &str) -> Result<Vec<String>, Problem> {
        self.texts(name)
    }
}

fn read(source: &Source, options: &ReadOptions) -> Result<Dataset, Problem> {
    if crate::hdf5::is_hdf5(source.bytes()) {
        return crate::hdf5::read(source, options);
    }
    let file = Classic::parse(source)?;
    if file.dimension("num_nodes").is_none() {
        return Err(Problem::unsupported_but(
            "a NetCDF file that is no Exodus II file",
            "it has no dimension `num_nodes`",
        ));
    }
    from_variables(Arc::new(file), options)
}

/// Reads a file whose container is open.
///
/// # Errors
/// [`Problem`] where it breaks the rules.
pub(crate) fn from_variables(
    file: Arc<dyn Variables>,
    options: &ReadOptions,
) -> Result<Dataset, Problem> {
    let times = times(&*file)?;
    let step = options.step.unwrap_or(0);
    if step > 0 && step >= times.len() {
        return Err(Problem::malformed(
            "the time steps",
            format!("step {step}"),
            format!("{} steps", times.len()),
        ));
    }
    let positions = positions(&*file)?;
    let num_points = positions.tuples();
    let blocks = blocks::read(&*file)?;
    let at = |point: u64| {
        let point = usize::try_from(point).ok().filter(|&p| p < num_points)?;
        let at = |axis| positions.get_f64(point, axis);
        Some(DVec3::new(at(0), at(1), at(2)))
    };
    let faces = |cell: usize, _: &[u64]| blocks.polyhedron(cell);
    let mut cells = assemble(
        &SourceCells {
            types: Cow::Borrowed(&blocks.types),
            ends: Some(Ends::List(blocks.ends.clone())),
            connectivity: blocks.connectivity.clone(),
            faces: Some(&faces),
            what: "the element blocks".to_owned(),
        },
        &at,
    )?;
    for (kind, count) in blocks::side_sets(&*file, &blocks.types)? {
        *cells.changed.entry(kind).or_default() += count;
    }
    let mut notes = Vec::new();
    let fields = fields::list(&file, step, num_points, &blocks, &mut notes)?;
    let part = Part {
        positions,
        cells,
        fields,
        point_flags: None,
        cell_flags: None,
    };
    Ok(join(vec![part], notes)?.with_times(times, step))
}

/// The times of the steps.
fn times(file: &dyn Variables) -> Result<Vec<f64>, Problem> {
    let Some(shape) = file.shape("time_whole") else {
        return Ok(Vec::new());
    };
    let mut times = Vec::new();
    let count = shape.lens.first().copied().unwrap_or(0);
    if !shape.has_records {
        let all = file.numbers("time_whole", 0, 0, 1, count)?;
        return Ok((0..count).map(|i| all.get_f64(i, 0)).collect());
    }
    for record in 0..count {
        times.push(file.numbers("time_whole", record, 0, 1, 1)?.get_f64(0, 0));
    }
    Ok(times)
}

/// Positions of all nodes; missing coordinates are 0.
fn positions(file: &dyn Variables) -> Result<DataArray, Problem> {
    let num_points = file
        .dimension("num_nodes")
        .ok_or_else(|| Problem::malformed("the dimensions", "`num_nodes`", "none"))?;
    let num_dim = file.dimension("num_dim").unwrap_or(3).min(3);
    let column = |axis: usize| -> Result<Option<DataArray>, Problem> {
        if axis >= num_dim {
            return Ok(None);
        }
        if file.shape("coord").is_some() {
            let first = axis.saturating_mul(num_points);
            return file.numbers("coord", 0, first, 1, num_points).map(Some);
        }
        let name = ["coordx", "coordy", "coordz"][axis];
        match file.shape(name) {
            None => Ok(None),
            Some(_) => file.numbers(name, 0, 0, 1, num_points).map(Some),
        }
    };
    let columns = [column(0)?, column(1)?, column(2)?];
    if num_points > 0 && columns.iter().all(Option::is_none) {
        return Err(Problem::malformed(
            "the variables",
            "`coord`, or `coordx` and its like",
            "none",
        ));
    }
    fields::interleaved(&columns, num_points)
}
