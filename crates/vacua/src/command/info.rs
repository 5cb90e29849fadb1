//! `vacua info`: what is in a file.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::DVec3;
use serde::Serialize;
use serde_json::{Number, Value};
use vacua_pack::file::{PackedFile, VectorComponent};
use vacua_volume::{
    Bounds, CellType, DataArray, Dataset, Scalar, ScalarType, UnstructuredMesh, ValueRange,
};

use super::input::{InputArgs, Opened};
use super::packed::{self, Bytes, Memory, VariantName};
use super::{Failure, output};

/// Arguments of `vacua info`.
#[derive(clap::Args, Debug)]
pub struct InfoArgs {
    #[command(flatten)]
    input: InputArgs,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What `vacua info --json` prints.
#[derive(Serialize)]
struct Info {
    file: String,
    kind: &'static str,
    /// Points a side of a grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    dimensions: Option<[usize; 3]>,
    /// Number of points of a mesh.
    #[serde(skip_serializing_if = "Option::is_none")]
    points: Option<u64>,
    /// Cells of a mesh by type; those below three dimensions under their own names.
    #[serde(skip_serializing_if = "Option::is_none")]
    cells: Option<serde_json::Map<String, Value>>,
    bounds: [f64; 6],
    /// Anatomical frame of the coordinates, where the file says one: `RAS`, `LAS`, `LPS`.
    #[serde(skip_serializing_if = "Option::is_none")]
    frame: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    blanked_cells: Option<usize>,
    /// How a `.vacua` file is packed.
    #[serde(skip_serializing_if = "Option::is_none")]
    packed: Option<PackedInfo>,
    fields: Vec<FieldInfo>,
    time_steps: usize,
    time_step: usize,
    /// Times of the steps, where the file says them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    times: Vec<f64>,
    notes: Vec<String>,
}

/// How a `.vacua` file is packed.
#[derive(Serialize)]
struct PackedInfo {
    variant: VariantName,
    index_bits: u32,
    file_bytes: u64,
    #[serde(flatten)]
    memory: Memory,
}

#[derive(Serialize)]
struct FieldInfo {
    name: String,
    association: String,
    #[serde(rename = "type")]
    scalar_type: &'static str,
    components: usize,
    /// `[lo, hi]`, null without finite values; a list of them for several components.
    range: Value,
    /// Of which time step a field of a `.vacua` file is, and its time, if there are several.
    #[serde(skip_serializing_if = "Option::is_none")]
    step: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<f64>,
}

/// Runs `vacua info`.
pub fn run(args: &InfoArgs) -> Result<(), Failure> {
    if let Some(file) = packed::open(&args.input)? {
        let info = describe_packed(&file, &args.input)?;
        return print(args, &info);
    }
    let opened = args.input.open()?;
    let info = output::during("reading the values", || describe(&opened))?;
    print(args, &info)
}

fn print(args: &InfoArgs, info: &Info) -> Result<(), Failure> {
    if args.json {
        output::print_json(info)
    } else {
        output::print(&as_text(info))
    }
}

/// What a `.vacua` file says of itself, without a look at its cells or values.
fn describe_packed(file: &PackedFile, input: &InputArgs) -> Result<Info, Failure> {
    let summary = file.summary()?;
    let steps = file.steps()?;
    // All fields of all steps, unless one step is asked for.
    let (groups, time_step) = match input.time {
        None => (file.groups()?, 0),
        Some(_) => {
            let step = packed::step(file, input)?;
            let place = steps.iter().position(|s| Some(s.number) == step);
            (file.groups_of(step)?, place.unwrap_or(0))
        }
    };
    let fields = groups.iter().map(|group| {
        let range_of = |place: usize| {
            let range = summary.fields.get(place).and_then(|field| field.range);
            range_json(range, group.scalar_type)
        };
        // As other formats list them: without the magnitude.
        let of_components = group.parts.iter().filter_map(|&(part, place)| match part {
            Some(VectorComponent::Index(_)) => Some(range_of(place)),
            _ => None,
        });
        FieldInfo {
            name: group.name.clone(),
            association: group.association.to_string(),
            scalar_type: group.scalar_type.name(),
            components: group.components(),
            range: match group.parts.as_slice() {
                [(None, place)] => range_of(*place),
                _ => Value::Array(of_components.collect()),
            },
            step: group.step.map(|s| s.number),
            time: group.step.map(|s| s.time),
        }
    });
    let bytes = summary.fields.iter().map(|field| field.bytes);
    let Bounds { lo, hi } = summary.bounds.unwrap_or(Bounds {
        lo: DVec3::ZERO,
        hi: DVec3::ZERO,
    });
    Ok(Info {
        file: input.files[0].display().to_string(),
        kind: "unstructured",
        dimensions: None,
        points: Some(summary.num_vertices),
        cells: Some(packed::cells_by_name(summary.num_cells_by_type)),
        bounds: [lo.x, hi.x, lo.y, hi.y, lo.z, hi.z],
        frame: None,
        blanked_cells: None,
        packed: Some(PackedInfo {
            variant: summary.variant.into(),
            index_bits: summary.index_bits,
            file_bytes: file.num_bytes(),
            memory: Memory::new(
                summary.num_cells_by_type,
                summary.num_vertices,
                summary.num_submeshes,
                summary.num_nodes,
                Bytes::new(summary.bytes, bytes).with_map(summary.map_bytes),
                summary
                    .fields
                    .iter()
                    .map(|f| f.entry.name.clone())
                    .collect(),
            ),
        }),
        fields: fields.collect(),
        time_steps: steps.len().max(1),
        time_step,
        times: steps.iter().map(|s| s.time).collect(),
        notes: Vec::new(),
    })
}

fn describe(opened: &Opened) -> Result<Info, Failure> {
    let dataset: &Dataset = &opened.dataset;
    let geometry = dataset.geometry();
    let bounds = geometry.bounds();
    let mut fields = Vec::new();
    for field in dataset.fields() {
        let values = field
            .load()
            .map_err(|e| Failure::contents(&opened.path, e))?;
        let mut ranges: Vec<Value> = (0..values.components())
            .map(|c| exact_range(values, c))
            .collect();
        fields.push(FieldInfo {
            name: field.name().to_owned(),
            association: field.association().to_string(),
            scalar_type: field.scalar_type().name(),
            components: field.components(),
            range: match ranges.len() {
                1 => ranges.swap_remove(0),
                _ => Value::Array(ranges),
            },
            step: None,
            time: None,
        });
    }
    Ok(Info {
        file: opened.path.display().to_string(),
        kind: geometry.kind(),
        dimensions: geometry.dimensions(),
        points: dataset.mesh().map(|mesh| mesh.num_points() as u64),
        cells: dataset.mesh().map(cells_by_type),
        bounds: [
            bounds.lo.x,
            bounds.hi.x,
            bounds.lo.y,
            bounds.hi.y,
            bounds.lo.z,
            bounds.hi.z,
        ],
        frame: dataset.frame().letters(),
        blanked_cells: dataset.blanked_cells().map(|mask| mask.num_blank()),
        packed: None,
        fields,
        time_steps: opened.num_steps,
        time_step: opened.step,
        times: dataset.times().to_vec(),
        notes: dataset.notes().to_vec(),
    })
}

/// How many cells of which type a mesh and its file have.
fn cells_by_type(mesh: &UnstructuredMesh) -> serde_json::Map<String, Value> {
    let counts = mesh.num_cells_by_type();
    let of_mesh = CellType::ALL.into_iter().zip(counts);
    let of_mesh = of_mesh.filter(|&(_, count)| count > 0);
    let left_out = mesh.left_out().iter().map(|l| (l.name, l.count));
    of_mesh
        .map(|(cell_type, count)| (cell_type.name(), count))
        .chain(left_out)
        .map(|(name, count)| (name.to_owned(), Value::from(count)))
        .collect()
}

/// The range of a component as JSON. Integers of 64 bits stay as they are, which `f64` does not hold.
fn exact_range(values: &DataArray, component: usize) -> Value {
    fn ends<T: Scalar + Ord + Into<Number>>(values: &DataArray, component: usize) -> Option<Value> {
        let all = values.as_slice::<T>()?;
        let of_component = || all.iter().skip(component).step_by(values.components());
        let (lo, hi) = (of_component().min()?, of_component().max()?);
        Some(Value::Array(
            [*lo, *hi].map(|end| Value::Number(end.into())).to_vec(),
        ))
    }
    let exact = match values.scalar_type() {
        ScalarType::U64 => ends::<u64>(values, component),
        ScalarType::I64 => ends::<i64>(values, component),
        _ => None,
    };
    exact.unwrap_or_else(|| range_json(values.range(component), values.scalar_type()))
}

/// A range as JSON; whole numbers of whole-number types print as such.
fn range_json(range: Option<ValueRange>, scalar_type: ScalarType) -> Value {
    let Some(ValueRange { lo, hi }) = range else {
        return Value::Null;
    };
    let float = matches!(scalar_type, ScalarType::F32 | ScalarType::F64);
    let number = |value: f64| {
        let whole = !float && value.abs() < 2f64.powi(63);
        let number = if whole {
            Some(Number::from(value as i64))
        } else {
            Number::from_f64(value)
        };
        number.map_or(Value::Null, Value::Number)
    };
    Value::Array(vec![number(lo), number(hi)])
}

fn as_text(info: &Info) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write_text(&mut text, info);
    text.trim_end().to_owned()
}

fn write_text(out: &mut String, info: &Info) -> std::fmt::Result {
    let [x0, x1, y0, y1, z0, z1] = info.bounds;
    writeln!(out, "{}", info.file)?;
    if let Some([nx, ny, nz]) = info.dimensions {
        writeln!(out, "  {} grid, {nx} × {ny} × {nz} points", info.kind)?;
    }
    if let Some(points) = info.points {
        writeln!(out, "  {} mesh, {points} points", info.kind)?;
    }
    for (name, count) in info.cells.iter().flatten() {
        writeln!(out, "  {count} × {name}")?;
    }
    let frame = info.frame.map_or(String::new(), |f| format!(" ({f})"));
    writeln!(
        out,
        "  x {x0} to {x1}, y {y0} to {y1}, z {z0} to {z1}{frame}"
    )?;
    if let Some(blanked) = info.blanked_cells {
        writeln!(out, "  {blanked} cells blanked")?;
    }
    if let Some(packed) = &info.packed {
        writeln!(
            out,
            "  packed: variant {}, {} index bits, {}",
            packed.variant,
            packed.index_bits,
            packed::bytes_text(packed.file_bytes)
        )?;
        for line in packed.memory.table() {
            writeln!(out, "{line}")?;
        }
    }
    if info.time_steps > 1 {
        writeln!(
            out,
            "  step {} of {} (0 to {})",
            info.time_step,
            info.time_steps,
            info.time_steps - 1
        )?;
        if !info.times.is_empty() {
            let times: Vec<String> = info.times.iter().map(f64::to_string).collect();
            writeln!(out, "  times {}", times.join(", "))?;
        }
    }
    if info.fields.is_empty() {
        writeln!(out, "  no fields")?;
    }
    let widest = info
        .fields
        .iter()
        .map(|f| f.name.chars().count())
        .max()
        .unwrap_or(0);
    let mut numbers = BTreeMap::new();
    for field in &info.fields {
        // Fields are counted within their time step.
        let number = numbers.entry(field.step).or_insert(0usize);
        let (i, step) = match (field.step, field.time) {
            (Some(step), Some(time)) => (*number, format!("  step {step}, time {time}")),
            _ => (*number, String::new()),
        };
        *number += 1;
        let several = if field.components > 1 {
            format!(" × {}", field.components)
        } else {
            String::new()
        };
        writeln!(
            out,
            "  #{i} {:widest$}  {} {}{several}  {}{step}",
            field.name,
            field.association,
            field.scalar_type,
            range_text(&field.range)
        )?;
    }
    Ok(())
}

fn range_text(range: &Value) -> String {
    match range {
        Value::Array(ends) if ends.len() == 2 && ends.iter().all(Value::is_number) => {
            format!("{} to {}", ends[0], ends[1])
        }
        Value::Array(components) => components
            .iter()
            .map(range_text)
            .collect::<Vec<_>>()
            .join(", "),
        _ => "no finite value".to_owned(),
    }
}
