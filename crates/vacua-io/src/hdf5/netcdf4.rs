//! Exodus II in NetCDF-4 files: what NetCDF calls dimensions and variables, in an HDF5 file.
//!
//! Source: *NetCDF-4 file format*, Unidata: a dimension is an array with the attribute `CLASS` =
//! `DIMENSION_SCALE`, whose length is the dimension's; it is also a variable unless its `NAME` says
//! that it is none. A variable that has the name of a dimension without being its scale has a prefix.

use std::collections::HashSet;
use std::sync::Arc;

use vacua_volume::{DataArray, Dataset};

use super::{Array, ArrayKind, Container};
use crate::error::Problem;
use crate::exodus::{Variables, from_variables};
use crate::netcdf::Shape;
use crate::registry::ReadOptions;

/// What the `NAME` of a dimension begins with that is no variable.
const NO_VARIABLE: &str = "This is a netCDF dimension but not a netCDF variable";

/// What the name of a variable begins with that shares its name with a dimension.
const SHARED_NAME: &str = "_nc4_non_coord_";

/// Reads an Exodus II file.
///
/// # Errors
/// [`Problem`] if it is none, or breaks the rules.
pub(super) fn read(container: Container, options: &ReadOptions) -> Result<Dataset, Problem> {
    let (_, names) = container.names("/")?;
    let file = NetCdf4 {
        container,
        names: names.into_iter().collect(),
    };
    if file.dimension("num_nodes").is_none() {
        return Err(Problem::unsupported_but(
            "an HDF5 file that is neither VTKHDF nor Exodus II",
            "it has no group `VTKHDF` and no dimension `num_nodes`; if an XDMF file describes it, \
             open that",
        ));
    }
    from_variables(Arc::new(file), options)
}

struct NetCdf4 {
    container: Container,
    names: HashSet<String>,
}

impl NetCdf4 {
    fn find(&self, name: &str) -> Result<Array, Problem> {
        let shared = format!("{SHARED_NAME}{name}");
        for name in [shared.as_str(), name] {
            if self.names.contains(name) {
                return self.container.need(name);
            }
        }
        self.container.need(name)
    }

    fn variable(&self, name: &str) -> Option<Array> {
        let array = self.find(name).ok()?;
        let is_variable = || {
            let name = array.text_of("NAME");
            !name.is_some_and(|n| n.starts_with(NO_VARIABLE))
        };
        is_variable().then_some(array)
    }
}

impl Variables for NetCdf4 {
    fn dimension(&self, name: &str) -> Option<usize> {
        if !self.names.contains(name) {
            return None;
        }
        let array = self.container.array(name).ok()??;
        let class = array.text_of("CLASS")?;
        (class == "DIMENSION_SCALE").then(|| array.rows())
    }

    fn shape(&self, name: &str) -> Option<Shape> {
        let array = self.variable(name)?;
        Some(Shape {
            scalar_type: match array.kind() {
                ArrayKind::Numbers(scalar_type) => Some(*scalar_type),
                _ => None,
            },
            lens: array.lens().to_vec(),
            has_records: array.is_unlimited(),
        })
    }

    fn text_of(&self, variable: &str, attribute: &str) -> Option<String> {
        self.find(variable).ok()?.text_of(attribute)
    }

    fn numbers(
        &self,
        name: &str,
        record: usize,
        first: usize,
        components: usize,
        tuples: usize,
    ) -> Result<DataArray, Problem> {
        let array = self.find(name)?;
        if !array.is_unlimited() {
            return array.read(first, components, tuples);
        }
        let count = tuples.saturating_mul(components);
        if record >= array.rows() {
            return Err(Problem::malformed(
                array.what(),
                format!("record {record}"),
                format!("{} records", array.rows()),
            ));
        }
        let len = array.row_len();
        if first.checked_add(count).is_none_or(|end| end > len) {
            return Err(Problem::malformed(
                array.what(),
                format!("{count} numbers from number {first} of a record on"),
                format!("{len} numbers"),
            ));
        }
        array.read(record * len + first, components, tuples)
    }

    fn texts(&self, name: &str) -> Result<Vec<String>, Problem> {
        self.find(name)?.texts()
    }
}
