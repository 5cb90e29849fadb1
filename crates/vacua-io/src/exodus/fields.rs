//! Fields: which there are, and how they are put together from variables and blocks.

use std::sync::Arc;

use vacua_volume::{Association, DataArray, Scalar, ScalarType, dispatch_scalar};

use super::Variables;
use super::blocks::{Blocks, MAX_LISTED};
use crate::error::Problem;
use crate::mesh::PartField;

/// The fields of a step.
///
/// # Errors
/// [`Problem`] if the lists of names cannot be read.
pub(super) fn list(
    file: &Arc<dyn Variables>,
    step: usize,
    num_points: usize,
    blocks: &Blocks,
    notes: &mut Vec<String>,
) -> Result<Vec<PartField>, Problem> {
    let mut fields = Vec::new();
    for (first, name, components) in vectors(&names(&**file, "name_nod_var", "num_nod_var")?) {
        let columns: Vec<Column> = (first..first + components)
            .map(|number| Column::nodal(&**file, number, num_points))
            .collect::<Option<_>>()
            .unwrap_or_default();
        match scalar_type(&**file, columns.iter().map(|c| c.variable.as_str())) {
            Some(scalar_type) if !columns.is_empty() => {
                let tuples = num_points;
                let load = loader(file, step, vec![(columns, tuples)], scalar_type);
                let association = Association::Point;
                fields.push(field(name, association, scalar_type, components, load));
            }
            _ => notes.push(format!(
                "point variable `{name}` has no values and is left out"
            )),
        }
    }
    for (first, name, components) in vectors(&names(&**file, "name_elem_var", "num_elem_var")?) {
        let of_blocks: Vec<(Vec<Column>, usize)> = blocks
            .lens
            .iter()
            .enumerate()
            .map(|(block, &len)| {
                let column = |number| Column {
                    variable: format!("vals_elem_var{}eb{}", number + 1, block + 1),
                    first: 0,
                };
                ((first..first + components).map(column).collect(), len)
            })
            .collect();
        let variables = of_blocks.iter().flat_map(|(c, _)| c.iter());
        match scalar_type(&**file, variables.map(|c| c.variable.as_str())) {
            Some(scalar_type) => {
                let load = loader(file, step, of_blocks, scalar_type);
                let association = Association::Cell;
                fields.push(field(name, association, scalar_type, components, load));
            }
            None => notes.push(format!(
                "cell variable `{name}` has no values and is left out"
            )),
        }
    }
    Ok(fields)
}

fn names(file: &dyn Variables, list: &str, count: &str) -> Result<Vec<String>, Problem> {
    if file.dimension(count).unwrap_or(0) == 0 || file.shape(list).is_none() {
        return Ok(Vec::new());
    }
    let names = file.texts(list)?;
    if names.len() > MAX_LISTED {
        return Err(Problem::unsupported(format!("{} variables", names.len())));
    }
    Ok(names)
}

/// Variables one by one, or as vectors of three where their names end in X, Y, Z: the number of the
/// first, the name, and how many.
fn vectors(names: &[String]) -> Vec<(usize, String, usize)> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < names.len() {
        let vector = names.get(at..at + 3).and_then(|three| {
            ["XYZ", "xyz"].iter().find_map(|ends| {
                let stems: Option<Vec<&str>> = three
                    .iter()
                    .zip(ends.chars())
                    .map(|(n, end)| n.strip_suffix(end))
                    .collect();
                let stem = stems.filter(|s| s.iter().all(|stem| *stem == s[0]))?[0];
                let name = stem.trim_end_matches(['_', ' ', '-']);
                (!name.is_empty()).then(|| name.to_owned())
            })
        });
        match vector {
            Some(name) => {
                found.push((at, name, 3));
                at += 3;
            }
            None => {
                found.push((at, names[at].clone(), 1));
                at += 1;
            }
        }
    }
    found
}

/// One component: a variable, and the first of its numbers.
struct Column {
    variable: String,
    first: usize,
}

impl Column {
    /// A nodal variable: of its own, or a piece of the one that older files have.
    fn nodal(file: &dyn Variables, number: usize, num_points: usize) -> Option<Self> {
        let own = format!("vals_nod_var{}", number + 1);
        if file.shape(&own).is_some() {
            return Some(Self {
                variable: own,
                first: 0,
            });
        }
        let common = "vals_nod_var";
        file.shape(common)?;
        Some(Self {
            variable: common.to_owned(),
            first: number.checked_mul(num_points)?,
        })
    }
}

/// The widest type of the variables that there are.
fn scalar_type<'a>(
    file: &dyn Variables,
    variables: impl Iterator<Item = &'a str>,
) -> Option<ScalarType> {
    let types = variables.filter_map(|name| file.shape(name)?.scalar_type);
    types.reduce(|a, b| if a == b { a } else { ScalarType::F64 })
}

type Load = Arc<dyn Fn() -> Result<DataArray, Problem> + Send + Sync>;

/// Reads blocks of columns, one block after the other; columns that are not there are not numbers.
fn loader(
    file: &Arc<dyn Variables>,
    step: usize,
    blocks: Vec<(Vec<Column>, usize)>,
    scalar_type: ScalarType,
) -> Load {
    let file = file.clone();
    Arc::new(move || {
        dispatch_scalar!(scalar_type, T => {
            let mut all: Vec<T> = Vec::new();
            let mut components = 1;
            for (columns, len) in &blocks {
                components = columns.len();
                let read = |column: &Column| -> Result<Option<DataArray>, Problem> {
                    if file.shape(&column.variable).is_none() {
                        return Ok(None);
                    }
                    file.numbers(&column.variable, step, column.first, 1, *len).map(Some)
                };
                let columns: Vec<Option<DataArray>> =
                    columns.iter().map(read).collect::<Result<_, _>>()?;
                interleave::<T>(&columns, *len, T::from_f64(f64::NAN), &mut all);
            }
            Ok(DataArray::from_vec(all, components)?)
        })
    })
}

/// Appends tuples made of columns.
fn interleave<T: Scalar>(columns: &[Option<DataArray>], len: usize, none: T, all: &mut Vec<T>) {
    let start = all.len();
    all.resize(start + len * columns.len(), none);
    let tuples = &mut all[start..];
    for (component, column) in columns.iter().enumerate() {
        let Some(column) = column else {
            continue;
        };
        let places = tuples.iter_mut().skip(component).step_by(columns.len());
        match column.as_slice::<T>() {
            Some(same) => places.zip(same).for_each(|(to, &from)| *to = from),
            None => places
                .enumerate()
                .for_each(|(i, to)| *to = T::from_f64(column.get_f64(i, 0))),
        }
    }
}

/// Columns as one array, of `f32` if they all are, else of `f64`. Columns that are not there are 0.
///
/// # Errors
/// None in practice.
pub(super) fn interleaved(columns: &[Option<DataArray>], len: usize) -> Result<DataArray, Problem> {
    let narrow = columns
        .iter()
        .flatten()
        .all(|c| c.scalar_type() == ScalarType::F32);
    if narrow {
        let mut all = Vec::new();
        interleave::<f32>(columns, len, 0.0, &mut all);
        return Ok(DataArray::from_vec(all, columns.len())?);
    }
    let mut all = Vec::new();
    interleave::<f64>(columns, len, 0.0, &mut all);
    Ok(DataArray::from_vec(all, columns.len())?)
}

fn field(
    name: String,
    association: Association,
    scalar_type: ScalarType,
    components: usize,
    load: Load,
) -> PartField {
    PartField {
        name,
        association,
        scalar_type,
        components,
        load,
        check: Arc::new(|| Ok(())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_in_a_row_are_a_vector() {
        let names = [
            "Temp", "VX", "VY", "VZ", "disp_x", "disp_y", "disp_z", "AX", "AY", "X", "Y", "Z",
        ];
        let found = vectors(&names.map(str::to_owned));
        let found: Vec<_> = found
            .iter()
            .map(|(at, n, c)| (*at, n.as_str(), *c))
            .collect();
        let expected = [
            (0, "Temp", 1),
            (1, "V", 3),
            (4, "disp", 3),
            (7, "AX", 1),
            (8, "AY", 1),
            (9, "X", 1),
            (10, "Y", 1),
            (11, "Z", 1),
        ];
        assert_eq!(found, expected);
    }
}
