//! Element blocks: which cells, and which nodes they have.

use std::collections::BTreeMap;

use vacua_volume::{CellType, DataArray};

use super::Variables;
use crate::error::Problem;
use crate::mesh::index_at;
use crate::mesh::kind::{Treatment, kind, vtk};

/// Most element blocks, node sets or variables that are looked at.
pub(super) const MAX_LISTED: usize = 1 << 16;

/// The cells of all blocks, one block after the other.
pub(super) struct Blocks {
    /// VTK's number for each cell.
    pub types: Vec<u8>,
    /// Where each cell's points end.
    pub ends: Vec<u64>,
    /// Points from 0.
    pub connectivity: DataArray,
    /// Cells of each block, by its number from 1 less 1.
    pub lens: Vec<usize>,
    /// Where the faces of polyhedra end in their list, and the list: `faces` from 0.
    faces: Option<FaceBlocks>,
}

/// Faces that polyhedra are made of.
struct FaceBlocks {
    /// First of the cells that are polyhedra, and for each of them its faces.
    of_cells: BTreeMap<usize, Vec<u64>>,
    /// Points of each face.
    faces: Vec<Vec<u64>>,
}

impl Blocks {
    /// The faces of a polyhedron.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if the file has them not.
    pub fn polyhedron(&self, cell: usize) -> Result<Vec<Vec<u64>>, Problem> {
        let faces = self.faces.as_ref().and_then(|blocks| {
            let face = |&face: &u64| blocks.faces.get(usize::try_from(face).ok()?).cloned();
            blocks.of_cells.get(&cell)?.iter().map(face).collect()
        });
        faces.ok_or_else(|| {
            Problem::malformed(
                format!("polyhedron {cell}"),
                "faces that there are",
                "others",
            )
        })
    }
}

/// VTK's number for the cells of a block.
fn cell_kind(name: &str, num_nodes: usize, num_dim: usize) -> Option<u8> {
    let name = name.to_ascii_uppercase();
    let starts = |words: &[&str]| words.iter().any(|word| name.starts_with(word));
    Some(if starts(&["HEX"]) {
        match num_nodes {
            8 => vtk::HEXAHEDRON,
            20 => vtk::QUADRATIC_HEXAHEDRON,
            27 => vtk::TRIQUADRATIC_HEXAHEDRON,
            _ => vtk::LAGRANGE_HEXAHEDRON,
        }
    } else if starts(&["TET"]) {
        match num_nodes {
            4 => vtk::TETRA,
            10 => vtk::QUADRATIC_TETRA,
            _ => vtk::LAGRANGE_TETRAHEDRON,
        }
    } else if starts(&["WED"]) {
        match num_nodes {
            6 => vtk::WEDGE,
            15 => vtk::QUADRATIC_WEDGE,
            18 => vtk::BIQUADRATIC_QUADRATIC_WEDGE,
            _ => vtk::LAGRANGE_WEDGE,
        }
    } else if starts(&["PYR"]) {
        match num_nodes {
            5 => vtk::PYRAMID,
            13 => vtk::QUADRATIC_PYRAMID,
            _ => vtk::LAGRANGE_PYRAMID,
        }
    } else if starts(&["NFACED"]) {
        vtk::POLYHEDRON
    } else if starts(&["NSIDED"]) {
        vtk::POLYGON
    } else if starts(&["TRI"]) {
        match num_nodes {
            3 => vtk::TRIANGLE,
            _ => vtk::QUADRATIC_TRIANGLE,
        }
    } else if starts(&["QUAD", "SHELL"]) {
        match (num_nodes, num_dim) {
            (2, _) => vtk::LINE,
            (3, 2) => vtk::QUADRATIC_EDGE,
            (3, _) => vtk::TRIANGLE,
            (4, _) => vtk::QUAD,
            (9, _) => vtk::BIQUADRATIC_QUAD,
            _ => vtk::QUADRATIC_QUAD,
        }
    } else if starts(&["BEA", "BAR", "TRU", "EDG", "ROD", "LIN", "SPR"]) {
        match num_nodes {
            2 => vtk::LINE,
            3 => vtk::QUADRATIC_EDGE,
            _ => vtk::POLY_LINE,
        }
    } else if starts(&["SPH", "CIR", "POI"]) {
        match num_nodes {
            1 => vtk::VERTEX,
            _ => vtk::POLY_VERTEX,
        }
    } else {
        return None;
    })
}

/// Reads all element blocks.
///
/// # Errors
/// [`Problem`] where they break the rules, or have elements that are not understood.
pub(super) fn read(file: &dyn Variables) -> Result<Blocks, Problem> {
    let num_blocks = file.dimension("num_el_blk").unwrap_or(0);
    if num_blocks > MAX_LISTED {
        return Err(Problem::unsupported(format!("{num_blocks} element blocks")));
    }
    let num_dim = file.dimension("num_dim").unwrap_or(3);
    let mut reader = Reader {
        file,
        types: Vec::new(),
        ends: Vec::new(),
        connectivity: Vec::new(),
        of_cells: BTreeMap::new(),
    };
    let mut lens = Vec::new();
    for block in 1..=num_blocks {
        let before = reader.types.len();
        reader.read_block(block, num_dim)?;
        lens.push(reader.types.len() - before);
    }
    let faces = if reader.of_cells.is_empty() {
        None
    } else {
        Some(FaceBlocks {
            faces: read_faces(file)?,
            of_cells: reader.of_cells,
        })
    };
    Ok(Blocks {
        types: reader.types,
        ends: reader.ends,
        connectivity: DataArray::from_vec(reader.connectivity, 1)?,
        lens,
        faces,
    })
}

struct Reader<'a> {
    file: &'a dyn Variables,
    types: Vec<u8>,
    ends: Vec<u64>,
    connectivity: Vec<i64>,
    of_cells: BTreeMap<usize, Vec<u64>>,
}

impl Reader<'_> {
    fn read_block(&mut self, block: usize, num_dim: usize) -> Result<(), Problem> {
        let num_cells = self
            .file
            .dimension(&format!("num_el_in_blk{block}"))
            .unwrap_or(0);
        if num_cells == 0 {
            return Ok(());
        }
        let name = format!("connect{block}");
        let shape = self.file.shape(&name);
        let shape = shape.ok_or_else(|| {
            Problem::malformed("the variables", format!("`{name}`"), "none of that name")
        })?;
        let elements = self.file.text_of(&name, "elem_type").unwrap_or_default();
        let width = match shape.lens.as_slice() {
            [_, width] => Some(*width),
            _ => None,
        };
        let kind = cell_kind(elements.trim(), width.unwrap_or(0), num_dim).ok_or_else(|| {
            Problem::unsupported(format!("the element type `{elements}` of `{name}`"))
        })?;
        let Some(width) = width else {
            return self.read_ragged(block, kind, num_cells);
        };
        if width == 0 {
            return Err(Problem::malformed(
                format!("variable `{name}`"),
                "nodes",
                "elements without any",
            ));
        }
        if shape.lens[0] != num_cells {
            return Err(Problem::malformed(
                format!("variable `{name}`"),
                format!("{num_cells} elements"),
                shape.lens[0].to_string(),
            ));
        }
        let nodes = self
            .file
            .numbers(&name, 0, 0, 1, num_cells.saturating_mul(width))?;
        self.extend(&nodes, &name)?;
        let first = self.ends.last().copied().unwrap_or(0);
        self.ends
            .extend((1..=num_cells as u64).map(|i| first + i * width as u64));
        self.types.resize(self.types.len() + num_cells, kind);
        Ok(())
    }

    /// Appends node numbers, from 1 in the file, from 0 here.
    fn extend(&mut self, nodes: &DataArray, name: &str) -> Result<(), Problem> {
        for place in 0..nodes.tuples() {
            let node = index_at(nodes, place).filter(|&n| n > 0).ok_or_else(|| {
                Problem::malformed(
                    format!("variable `{name}`"),
                    "node numbers from 1",
                    format!("something else at place {place}"),
                )
            })?;
            self.connectivity.push(node as i64 - 1);
        }
        Ok(())
    }

    /// A block of polygons or polyhedra: counts, then nodes or faces of all.
    fn read_ragged(&mut self, block: usize, kind: u8, num_cells: usize) -> Result<(), Problem> {
        let is_faced = kind == vtk::POLYHEDRON;
        let counts = self
            .file
            .numbers(&format!("ebepecnt{block}"), 0, 0, 1, num_cells)?;
        let name = match is_faced {
            true => format!("facconn{block}"),
            false => format!("connect{block}"),
        };
        let wrong = || {
            Problem::malformed(
                format!("variable `{name}`"),
                "as many numbers as its elements count",
                "another number",
            )
        };
        let shape = self.file.shape(&name).ok_or_else(wrong)?;
        let total = shape.lens.iter().product();
        let numbers = self.file.numbers(&name, 0, 0, 1, total)?;
        let mut at = 0usize;
        for cell in 0..num_cells {
            let count = index_at(&counts, cell).ok_or_else(wrong)?;
            let end = at
                .checked_add(count)
                .filter(|&e| e <= total)
                .ok_or_else(wrong)?;
            let of_cell: Option<Vec<u64>> = (at..end)
                .map(|i| index_at(&numbers, i)?.checked_sub(1).map(|n| n as u64))
                .collect();
            let of_cell = of_cell.ok_or_else(wrong)?;
            at = end;
            if is_faced {
                self.of_cells.insert(self.types.len(), of_cell);
            } else {
                self.connectivity.extend(of_cell.iter().map(|&n| n as i64));
            }
            self.ends.push(self.connectivity.len() as u64);
            self.types.push(kind);
        }
        Ok(())
    }
}

/// The faces of all face blocks.
fn read_faces(file: &dyn Variables) -> Result<Vec<Vec<u64>>, Problem> {
    let num_blocks = file.dimension("num_fa_blk").unwrap_or(0).min(MAX_LISTED);
    let mut faces = Vec::new();
    for block in 1..=num_blocks {
        let num_faces = file
            .dimension(&format!("num_fa_in_blk{block}"))
            .unwrap_or(0);
        let name = format!("fbconn{block}");
        let wrong = || {
            Problem::malformed(
                format!("variable `{name}`"),
                "as many nodes as its faces count",
                "another number",
            )
        };
        let counts = file.numbers(&format!("fbepecnt{block}"), 0, 0, 1, num_faces)?;
        let total = file.shape(&name).ok_or_else(wrong)?.lens.iter().product();
        let nodes = file.numbers(&name, 0, 0, 1, total)?;
        let mut at = 0usize;
        for face in 0..num_faces {
            let count = index_at(&counts, face).ok_or_else(wrong)?;
            let end = at
                .checked_add(count)
                .filter(|&e| e <= total)
                .ok_or_else(wrong)?;
            let points: Option<Vec<u64>> = (at..end)
                .map(|i| index_at(&nodes, i)?.checked_sub(1).map(|n| n as u64))
                .collect();
            faces.push(points.ok_or_else(wrong)?);
            at = end;
        }
    }
    Ok(faces)
}

/// How many faces of which kind the side sets have; those of cells below three dimensions do not
/// count.
///
/// # Errors
/// [`Problem`] if a side set cannot be read.
pub(super) fn side_sets(
    file: &dyn Variables,
    types: &[u8],
) -> Result<BTreeMap<u8, usize>, Problem> {
    let num_sets = file.dimension("num_side_sets").unwrap_or(0).min(MAX_LISTED);
    let mut counts = BTreeMap::new();
    for set in 1..=num_sets {
        let Some(num_sides) = file.dimension(&format!("num_side_ss{set}")) else {
            continue;
        };
        let (elements, sides) = (format!("elem_ss{set}"), format!("side_ss{set}"));
        if file.shape(&elements).is_none() || file.shape(&sides).is_none() {
            continue;
        }
        let elements = file.numbers(&elements, 0, 0, 1, num_sides)?;
        let sides = file.numbers(&sides, 0, 0, 1, num_sides)?;
        for i in 0..num_sides {
            let cell = index_at(&elements, i).and_then(|n| n.checked_sub(1));
            let cell_type = cell.and_then(|c| types.get(c)).and_then(|&t| solid(t));
            let side = index_at(&sides, i).unwrap_or(0);
            let kind = match (cell_type, side) {
                (None, _) | (_, 0) => continue,
                (Some(CellType::Tetrahedron), _)
                | (Some(CellType::Pyramid), 1..=4)
                | (Some(CellType::Wedge), 4 | 5) => vtk::TRIANGLE,
                _ => vtk::QUAD,
            };
            *counts.entry(kind).or_default() += 1;
        }
    }
    Ok(counts)
}

/// The linear cell that a kind of cell becomes.
fn solid(number: u8) -> Option<CellType> {
    match kind(number)?.treatment {
        Treatment::Keep(cell_type) => Some(cell_type),
        Treatment::Corners { linear, .. } => Some(linear),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_by_name() {
        assert_eq!(cell_kind("HEX8", 8, 3), Some(vtk::HEXAHEDRON));
        assert_eq!(cell_kind("hex", 27, 3), Some(vtk::TRIQUADRATIC_HEXAHEDRON));
        assert_eq!(cell_kind("TETRA", 10, 3), Some(vtk::QUADRATIC_TETRA));
        assert_eq!(cell_kind("tri3", 3, 2), Some(vtk::TRIANGLE));
        assert_eq!(cell_kind("SHELL4", 4, 3), Some(vtk::QUAD));
        assert_eq!(cell_kind("beam2", 2, 3), Some(vtk::LINE));
        assert_eq!(cell_kind("superelement", 100, 3), None);
    }
}
