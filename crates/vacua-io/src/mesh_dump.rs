//! The plain mesh dump (`.vmesh`): a few lines of text, then arrays as they are, little-endian, one
//! after the other in the order of the lines.
//!
//! ```text
//! vacua mesh 1
//! points 8 f32                 3 numbers a point: f32 or f64
//! cells hexahedron 1 u32       VTK's order; tetrahedron, pyramid, wedge, hexahedron; u32 i32 u64 i64
//! point pressure f64 1         a field on points: name (%20 for a space), type, components
//! cell material u8 1           a field on cells, in the order of all `cells` lines
//! end
//! ```
//!
//! Written in Python:
//!
//! ```python
//! with open("mesh.vmesh", "wb") as out:
//!     out.write(f"vacua mesh 1\npoints {len(points)} f32\ncells tetrahedron {len(tets)} u32\n"
//!               f"point temperature f32 1\nend\n".encode())
//!     points.astype("<f4").tofile(out)
//!     tets.astype("<u4").tofile(out)
//!     temperature.astype("<f4").tofile(out)
//! ```

use std::collections::BTreeMap;
use std::sync::Arc;

use vacua_volume::{Association, CellType, DataArray, Dataset, ScalarType};

use crate::error::Problem;
use crate::mesh::assemble::{Assembled, AssembledTypes};
use crate::mesh::{Part, PartField, index_at, join};
use crate::registry::{Format, ReadOptions};
use crate::source::Source;
use crate::vtk::array_in_file;

/// The plain mesh dump.
pub(crate) const FORMAT: Format = Format {
    name: "vacua mesh dump",
    extensions: &["vmesh"],
    sniff: Some(sniff),
    read,
};

const MARK: &[u8] = b"vacua mesh ";

/// Longest header.
const MAX_HEADER_BYTES: usize = 1 << 20;

fn sniff(bytes: &[u8]) -> bool {
    bytes.starts_with(MARK)
}

/// An array that a line announces.
#[derive(Clone, Debug)]
struct Announced {
    what: String,
    scalar_type: ScalarType,
    components: usize,
    tuples: usize,
    offset: usize,
}

impl Announced {
    fn read(&self, source: &Source) -> Result<DataArray, Problem> {
        let shape = (self.scalar_type, self.components, self.tuples);
        array_in_file(source, &self.what, self.offset, false, shape)
    }
}

/// What the lines say.
#[derive(Default)]
struct Head {
    points: Option<Announced>,
    cells: Vec<(CellType, Announced)>,
    fields: Vec<(String, Association, Announced)>,
    num_points: usize,
    num_cells: usize,
}

fn read(source: &Source, _: &ReadOptions) -> Result<Dataset, Problem> {
    let head = read_head(source)?;
    let points = head
        .points
        .as_ref()
        .ok_or_else(|| Problem::malformed("the header", "a line `points COUNT TYPE`", "none"))?;
    let positions = points.read(source)?;
    let cells = read_cells(source, &head)?;
    let fields = head
        .fields
        .into_iter()
        .map(|(name, association, announced)| {
            let source = source.clone();
            PartField {
                name,
                association,
                scalar_type: announced.scalar_type,
                components: announced.components,
                load: Arc::new(move || announced.read(&source)),
                check: Arc::new(|| Ok(())),
            }
        });
    let part = Part {
        positions,
        cells,
        fields: fields.collect(),
        point_flags: None,
        cell_flags: None,
    };
    join(vec![part], Vec::new())
}

fn read_cells(source: &Source, head: &Head) -> Result<Assembled, Problem> {
    let assembled = |types, connectivity| Assembled {
        types,
        connectivity,
        sources: None,
        num_source_cells: head.num_cells,
        changed: BTreeMap::new(),
    };
    if let [(cell_type, announced)] = head.cells.as_slice() {
        let types = AssembledTypes::Uniform(*cell_type, announced.tuples / cell_type.num_points());
        return Ok(assembled(types, announced.read(source)?));
    }
    let (mut types, mut connectivity) = (Vec::new(), Vec::new());
    for (cell_type, announced) in &head.cells {
        let array = announced.read(source)?;
        for place in 0..array.tuples() {
            let point = index_at(&array, place).and_then(|p| i64::try_from(p).ok());
            connectivity.push(point.ok_or_else(|| {
                Problem::malformed(&announced.what, "numbers of points", "a negative one")
            })?);
        }
        types.extend(std::iter::repeat_n(
            *cell_type,
            array.tuples() / cell_type.num_points(),
        ));
    }
    Ok(assembled(
        AssembledTypes::Mixed(types),
        DataArray::from_vec(connectivity, 1)?,
    ))
}

/// Reads the lines and checks that the file has all that they announce, and no more.
fn read_head(source: &Source) -> Result<Head, Problem> {
    let bytes = source.bytes();
    let mut head = Head::default();
    let mut next_byte = 0;
    let mut lines = Vec::new();
    loop {
        let rest = &bytes[next_byte..bytes.len().min(MAX_HEADER_BYTES).max(next_byte)];
        let len = memchr::memchr(b'\n', rest).ok_or_else(|| {
            Problem::malformed(format!("line {}", lines.len() + 1), "a line `end`", "none")
        })?;
        let line = String::from_utf8_lossy(&rest[..len]).trim().to_owned();
        next_byte += len + 1;
        if line == "end" {
            break;
        }
        lines.push(line);
    }
    let mut offset = next_byte;
    for (number, line) in (1..).zip(&lines) {
        let wrong = |expected: &str| {
            Problem::malformed(format!("line {number}"), expected, format!("`{line}`"))
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let count = |text: &str| text.parse::<usize>().map_err(|_| wrong("a count"));
        let number_type = |text: &str| {
            text.parse::<ScalarType>()
                .map_err(|_| wrong("a number type: u8 … i64, f32, f64"))
        };
        let mut announce = |what: String, scalar_type: ScalarType, components, tuples: usize| {
            let announced = Announced {
                what,
                scalar_type,
                components,
                tuples,
                offset,
            };
            let len = tuples
                .checked_mul(components)
                .and_then(|n| n.checked_mul(scalar_type.size_bytes()))
                .unwrap_or(usize::MAX);
            source.piece(&announced.what, offset, len)?;
            offset += len;
            Ok::<Announced, Problem>(announced)
        };
        match words.as_slice() {
            ["vacua", "mesh", "1"] if number == 1 => {}
            ["vacua", "mesh", version] if number == 1 => {
                return Err(Problem::unsupported(format!(
                    "version {version} of mesh dumps"
                )));
            }
            _ if number == 1 => return Err(wrong("`vacua mesh 1`")),
            [] => {}
            ["points", points, scalar_type] if head.points.is_none() => {
                head.num_points = count(points)?;
                let scalar_type = number_type(scalar_type)?;
                let what = "the points".to_owned();
                head.points = Some(announce(what, scalar_type, 3, head.num_points)?);
            }
            ["cells", name, cells, scalar_type] => {
                let cell_type = CellType::ALL.into_iter().find(|t| t.name() == *name);
                let cell_type =
                    cell_type.ok_or_else(|| wrong("tetrahedron, pyramid, wedge or hexahedron"))?;
                let integer = number_type(scalar_type)?;
                if !matches!(
                    integer,
                    ScalarType::U32 | ScalarType::I32 | ScalarType::U64 | ScalarType::I64
                ) {
                    return Err(wrong("u32, i32, u64 or i64"));
                }
                let cells = count(cells)?;
                let numbers = cells
                    .checked_mul(cell_type.num_points())
                    .ok_or_else(|| wrong("a plausible count"))?;
                let what = format!("the cells of line {number}");
                head.cells
                    .push((cell_type, announce(what, integer, 1, numbers)?));
                head.num_cells += cells;
            }
            [place @ ("point" | "cell"), name, scalar_type, components] => {
                let (association, tuples) = match *place {
                    "point" => (Association::Point, head.num_points),
                    _ => (Association::Cell, head.num_cells),
                };
                let components = count(components)?;
                if components == 0 {
                    return Err(wrong("at least 1 component"));
                }
                let name = percent_encoding::percent_decode_str(name).decode_utf8_lossy();
                let what = format!("field `{name}`");
                let scalar_type = number_type(scalar_type)?;
                let announced = announce(what, scalar_type, components, tuples)?;
                head.fields
                    .push((name.into_owned(), association, announced));
            }
            _ => return Err(wrong("points, cells, point, cell or end")),
        }
    }
    if lines.is_empty() {
        return Err(Problem::malformed("line 1", "`vacua mesh 1`", "`end`"));
    }
    if offset != bytes.len() {
        return Err(Problem::malformed(
            "the end of the file",
            format!("{offset} bytes, as its lines say"),
            bytes.len().to_string(),
        ));
    }
    Ok(head)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn file(head: &str, numbers: &[&[u8]]) -> Vec<u8> {
        let mut bytes = head.as_bytes().to_vec();
        numbers.iter().for_each(|n| bytes.extend_from_slice(n));
        bytes
    }

    fn open(bytes: Vec<u8>) -> Result<Dataset, Problem> {
        read(
            &Source::from_bytes(Path::new("t.vmesh"), bytes),
            &ReadOptions::default(),
        )
    }

    fn good() -> Vec<u8> {
        let points: Vec<u8> = (0..18).flat_map(|i| (i as f32).to_le_bytes()).collect();
        let tets: Vec<u8> = [0u32, 1, 2, 3]
            .iter()
            .flat_map(|i| i.to_le_bytes())
            .collect();
        let wedge: Vec<u8> = [5i64, 4, 3, 2, 1, 0]
            .iter()
            .flat_map(|i| i.to_le_bytes())
            .collect();
        let field: Vec<u8> = [7i16, -8].iter().flat_map(|i| i.to_le_bytes()).collect();
        file(
            "vacua mesh 1\npoints 6 f32\ncells tetrahedron 1 u32\ncells wedge 1 i64\n\
             cell my%20field i16 1\nend\n",
            &[&points, &tets, &wedge, &field],
        )
    }

    #[test]
    fn lines_then_arrays() {
        let dataset = open(good()).expect("as documented");
        let mesh = dataset.mesh().expect("a mesh");
        assert_eq!(mesh.num_cells_by_type(), [1, 0, 1, 0]);
        assert_eq!(mesh.cell(1).points(), [5, 4, 3, 2, 1, 0]);
        assert_eq!(mesh.position(5).to_array(), [15.0, 16.0, 17.0]);
        let field = &dataset.fields()[0];
        assert_eq!(
            (field.name(), field.association()),
            ("my field", Association::Cell)
        );
        assert_eq!(
            field.load().expect("there").as_slice::<i16>(),
            Some(&[7, -8][..])
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        let bytes = good();
        for len in 0..bytes.len() {
            assert!(open(bytes[..len].to_vec()).is_err(), "{len}");
        }
        let mut long = bytes.clone();
        long.push(0);
        assert!(open(long).is_err());
        for (head, word) in [
            ("vacua mesh 2\nend\n", "version 2"),
            ("vacua mesh 1\nend\n", "points"),
            ("vacua mesh 1\npoints -1 f32\nend\n", "count"),
            (
                "vacua mesh 1\npoints 99999999999999999 f64\nend\n",
                "truncated",
            ),
            (
                "vacua mesh 1\npoints 0 f32\ncells brick 1 u32\nend\n",
                "tetrahedron",
            ),
            (
                "vacua mesh 1\npoints 0 f32\ncells wedge 1 f32\nend\n",
                "u32",
            ),
            ("vacua mesh 1\npoints 0 u8\nend\n", "f32"),
            ("vacua mesh 1\nnonsense\nend\n", "line 2"),
        ] {
            let message = open(head.into()).expect_err(head).to_string();
            assert!(message.contains(word), "{head}: {message}");
        }
    }
}
