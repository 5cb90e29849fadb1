//! `.vacua` files among the inputs: what is in one, what it takes by part, and its values at points.

use serde::Serialize;
use serde_json::{Map, Value};
use vacua_io::Source;
use vacua_pack::file::{PackedFile, is_packed};
use vacua_pack::{FieldBytes, PackedBytes, PackedVolume, PackedVolumeError, Variant};
use vacua_volume::CellType;

use super::Failure;
use super::choice::{Candidate, FieldArgs};
use super::input::{InputArgs, choose};

/// Opens the input as a `.vacua` file, if it is one.
pub fn open(input: &InputArgs) -> Result<Option<PackedFile>, Failure> {
    let [path] = input.files.as_slice() else {
        return Ok(None);
    };
    if !path.is_file() {
        return Ok(None);
    }
    let source = Source::open(path)?;
    if !is_packed(source.bytes()) {
        return Ok(None);
    }
    Ok(Some(PackedFile::from_source(source)?))
}

/// A variant as people name it: 1, 2 or `small`.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(untagged)]
pub enum VariantName {
    /// One of the paper's two.
    Number(u8),
    /// Another.
    Name(&'static str),
}

impl From<Variant> for VariantName {
    fn from(variant: Variant) -> Self {
        match variant {
            Variant::MultiLeaves => Self::Number(1),
            Variant::MultiNodes => Self::Number(2),
            Variant::Small => Self::Name("small"),
        }
    }
}

impl std::fmt::Display for VariantName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => number.fmt(f),
            Self::Name(name) => name.fmt(f),
        }
    }
}

/// Bytes by part.
#[derive(Clone, Debug, Serialize)]
pub struct Bytes {
    vertices: u64,
    indices: u64,
    nodes: u64,
    outer: u64,
    sub_meshes: u64,
    /// Values of all fields.
    values: u64,
    /// Value ranges of all fields, with what finds the values of a cell.
    ranges: u64,
    total: u64,
    /// The map from packed to original order, if it is there: apart, not in the total.
    map: u64,
}

impl Bytes {
    /// The sums of a mesh and its fields.
    pub fn new(mesh: PackedBytes, fields: impl Iterator<Item = FieldBytes>) -> Self {
        let (mut values, mut ranges) = (0, 0);
        for field in fields {
            values += field.values as u64;
            ranges += (field.ranges + field.cells_before) as u64;
        }
        Self {
            vertices: mesh.positions as u64,
            indices: mesh.indices as u64,
            nodes: mesh.nodes as u64,
            outer: mesh.outer as u64,
            sub_meshes: mesh.submeshes as u64,
            values,
            ranges,
            total: mesh.total() as u64 + values + ranges,
            map: 0,
        }
    }

    /// With a map of so many bytes.
    pub fn with_map(mut self, bytes: u64) -> Self {
        self.map = bytes;
        self
    }
}

/// What a packed mesh takes: the columns of paper B's Table 3.
#[derive(Clone, Debug, Serialize)]
pub struct Memory {
    cells: Map<String, Value>,
    num_cells: u64,
    /// Replicated ones included.
    vertices: u64,
    sub_meshes: u64,
    nodes: u64,
    bytes: Bytes,
    bytes_per_cell: f64,
    fields: Vec<String>,
}

/// Counts by name; types without cells are left out.
pub fn cells_by_name(counts: [u64; 4]) -> Map<String, Value> {
    let all = CellType::ALL.into_iter().zip(counts);
    all.filter(|&(_, n)| n > 0)
        .map(|(cell_type, n)| (cell_type.name().to_owned(), Value::from(n)))
        .collect()
}

impl Memory {
    /// From what there is of each part.
    pub fn new(
        cells: [u64; 4],
        vertices: u64,
        sub_meshes: u64,
        nodes: u64,
        bytes: Bytes,
        fields: Vec<String>,
    ) -> Self {
        let num_cells: u64 = cells.iter().sum();
        Self {
            cells: cells_by_name(cells),
            num_cells,
            vertices,
            sub_meshes,
            nodes,
            bytes_per_cell: bytes.total as f64 / (num_cells as f64).max(1.0),
            bytes,
            fields,
        }
    }

    /// The cells in words.
    pub fn cells_text(&self) -> String {
        let cells: Vec<String> = self
            .cells
            .iter()
            .map(|(n, c)| format!("{c} × {n}"))
            .collect();
        match cells.as_slice() {
            [] => "no cells".to_owned(),
            cells => cells.join(", "),
        }
    }

    /// The table in lines.
    pub fn table(&self) -> Vec<String> {
        let per_cell = |bytes: u64| bytes as f64 / (self.num_cells as f64).max(1.0);
        let mut rows = vec![
            ("vertices", Some(self.vertices), self.bytes.vertices),
            ("indices", None, self.bytes.indices),
            ("nodes", Some(self.nodes), self.bytes.nodes),
            ("outer tree", None, self.bytes.outer),
            ("sub-meshes", Some(self.sub_meshes), self.bytes.sub_meshes),
        ];
        if !self.fields.is_empty() {
            let count = Some(self.fields.len() as u64);
            rows.push(("field values", count, self.bytes.values));
            rows.push(("value ranges", None, self.bytes.ranges));
        }
        rows.push(("total", None, self.bytes.total));
        if self.bytes.map > 0 {
            rows.push(("map (apart)", None, self.bytes.map));
        }
        let head = format!(
            "  {:12} {:>12} {:>12} {:>12}",
            "part", "count", "memory", "B a cell"
        );
        let row = |(name, count, bytes): (&str, Option<u64>, u64)| {
            let count = count.map_or(String::new(), |n| n.to_string());
            format!(
                "  {name:12} {count:>12} {:>12} {:>12.3}",
                bytes_text(bytes),
                per_cell(bytes)
            )
        };
        std::iter::once(head)
            .chain(rows.into_iter().map(row))
            .collect()
    }
}

/// Bytes in a unit that people read, of powers of 2 as in the paper.
pub fn bytes_text(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["B", "KB", "MB", "GB"];
    let mut value = bytes as f64;
    let mut unit = 0;
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    if unit == 0 {
        format!("{bytes} B")
    } else {
        format!("{value:.2} {}", UNITS[unit])
    }
}

/// The number of the time step that `--time` means; the first without. `None` in a file without steps.
pub fn step(file: &PackedFile, input: &InputArgs) -> Result<Option<u32>, Failure> {
    let steps = file.steps()?;
    let times: Vec<Option<f64>> = match steps.as_slice() {
        [] => vec![None],
        steps => steps.iter().map(|s| Some(s.time)).collect(),
    };
    let chosen = choose(&times, input.time.as_deref())?;
    Ok(steps.get(chosen).map(|s| s.number))
}

/// The chosen field of a `.vacua` file, of the chosen time step.
pub fn volume(
    file: &PackedFile,
    input: &InputArgs,
    field: &FieldArgs,
) -> Result<PackedVolume, Failure> {
    let step = step(file, input)?;
    let groups = file.groups_of(step)?;
    let candidates: Vec<Candidate> = groups
        .iter()
        .map(|group| Candidate {
            name: &group.name,
            scalar_type: group.scalar_type,
            association: group.association,
            components: group.components(),
        })
        .collect();
    let choice = field.choice(&input.files[0], &candidates);
    let component = field.component.unwrap_or_default();
    PackedVolume::open_part(file, step, &choice, component).map_err(|error| match error {
        PackedVolumeError::Io(error) => error.into(),
        error => Failure::contents(&input.files[0], error),
    })
}
