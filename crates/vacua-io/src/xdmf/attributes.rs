//! `<Attribute>`: values on nodes and cells.

use std::sync::Arc;

use vacua_volume::Association;

use super::document::Document;
use super::item::Item;
use super::word;
use crate::error::Problem;
use crate::vtk::xml::document::Element;

/// Values on the nodes or cells of a grid.
pub(super) struct Attribute {
    /// Their name; `scalars` if they have none.
    pub name: String,
    /// On nodes or on cells.
    pub association: Association,
    /// Numbers in a tuple.
    pub components: usize,
    /// The numbers.
    pub item: Item,
}

/// The attributes of a grid that has so many points and cells; what is on neither is noted.
///
/// # Errors
/// [`Problem`] if there are not as many numbers as there are points or cells, or a multiple.
pub(super) fn list(
    document: &Arc<Document>,
    grid: &Element,
    [num_points, num_cells]: [usize; 2],
    notes: &mut Vec<String>,
) -> Result<Vec<Attribute>, Problem> {
    let mut all = Vec::new();
    for element in document.children(grid, "Attribute")? {
        let name = element.attribute("Name").unwrap_or("scalars").to_owned();
        let center = word(element, &["Center"], "Node");
        let (association, tuples) = match center.as_str() {
            "NODE" => (Association::Point, num_points),
            "CELL" => (Association::Cell, num_cells),
            _ => {
                notes.push(format!("attribute `{name}` on `{center}` is left out"));
                continue;
            }
        };
        let item = Item::parse(document, document.child(element, "DataItem")?, None)?;
        let numbers = item.numbers();
        if tuples == 0 && numbers == 0 {
            continue;
        }
        if tuples == 0 || numbers == 0 || !numbers.is_multiple_of(tuples) {
            return Err(Problem::malformed(
                item.what,
                format!("values of attribute `{name}` for {tuples} {association}s"),
                format!("{:?} numbers", item.lens),
            ));
        }
        all.push(Attribute {
            name,
            association,
            components: numbers / tuples,
            item,
        });
    }
    Ok(all)
}
