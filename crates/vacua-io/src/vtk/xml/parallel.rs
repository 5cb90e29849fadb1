//! Parallel VTK XML files (`.pvti`, `.pvtr`, `.pvts`): grids whose pieces are serial files beside
//! them.

use std::path::Path;
use std::sync::Arc;

use super::document::XmlFile;
use super::structured::{GridKind, Structured, parse_extent};
use crate::error::Problem;
use crate::source::Source;
use crate::vtk::extent::Extent;

/// Opens the pieces and puts them together.
///
/// # Errors
/// [`Problem::Part`] if a piece cannot be read, [`Problem::Malformed`] if it is no serial file of
/// the same kind or has another extent than announced.
pub(super) fn read(file: &XmlFile, kind: GridKind) -> Result<Structured, Problem> {
    let data_set = file.data_set()?;
    let mut grid = Structured::new(kind, data_set)?;
    let folder = file.source.path().parent().unwrap_or(Path::new(""));
    for piece in data_set.children_named("Piece") {
        let announced = parse_extent(piece, "Extent")?;
        if announced.is_empty() {
            continue;
        }
        let name = Path::new(piece.required("Source")?);
        let path = folder.join(name);
        let source = Source::open(&path).map_err(Problem::part)?;
        let found = add_piece(&mut grid, &source, kind)
            .map_err(|problem| Problem::part(problem.in_file(&path)))?;
        if found != Some(announced) {
            return Err(Problem::malformed(
                piece.place(),
                format!("extent {announced}, as this file says"),
                match found {
                    Some(found) => format!("extent {found} in `{}`", name.display()),
                    None => format!("nothing in `{}`", name.display()),
                },
            ));
        }
    }
    Ok(grid)
}

fn add_piece(
    grid: &mut Structured,
    source: &Source,
    kind: GridKind,
) -> Result<Option<Extent>, Problem> {
    let part = XmlFile::parse(source)?;
    let type_name = part.root.required("type")?;
    if GridKind::from_type(type_name) != Some(kind) {
        return Err(Problem::malformed(
            "attribute `type` of <VTKFile>",
            format!("the serial type of a {kind:?} grid"),
            format!("`{type_name}`"),
        ));
    }
    grid.add_pieces(&Arc::new(part))
}
