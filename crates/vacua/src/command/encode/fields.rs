//! Which fields are encoded, of which time steps.

use vacua_pack::file::{FieldInput, FieldStep};
use vacua_volume::{ComponentChoice, Dataset, FieldChoice, UnstructuredMesh};

use super::super::input::{InputArgs, Opened};
use super::super::{Failure, Wrong, output, values};

/// A field to be packed: its name there, which it is, and which component.
type Choice = (String, FieldChoice, ComponentChoice);

/// Loads the fields that are asked for of the step that is open; all of them without a wish.
pub fn load(
    opened: &Opened,
    wanted: Option<&[String]>,
    step: Option<FieldStep>,
) -> Result<Vec<FieldInput>, Failure> {
    let dataset = &opened.dataset;
    let mut fields = Vec::new();
    for (name, choice, component) in choices(dataset, wanted, step.is_none_or(|s| s.number == 0))? {
        let volume = output::during(&format!("reading field `{name}`"), || {
            dataset
                .volume(&choice, component)
                .map_err(|e| Failure::contents(&opened.path, e))
        })?;
        fields.push(FieldInput {
            name,
            association: volume.association(),
            values: volume.scalars().clone(),
            step,
        });
    }
    Ok(fields)
}

/// Loads the fields of all time steps; the meshes of all must be the one that is open.
pub fn load_all_steps(
    input: &InputArgs,
    opened: &Opened,
    mesh: &UnstructuredMesh,
    wanted: Option<&[String]>,
) -> Result<Vec<FieldInput>, Failure> {
    let times = opened.dataset.times();
    let mut fields = Vec::new();
    for number in 0..opened.num_steps {
        let of_step = input.open_step(number)?;
        let same = of_step.dataset.mesh().is_some_and(|m| {
            m.positions().bytes() == mesh.positions().bytes()
                && m.connectivity().bytes() == mesh.connectivity().bytes()
                && m.num_cells_by_type() == mesh.num_cells_by_type()
        });
        if !same {
            return Err(Failure::plain(format!(
                "{}: step {number} has another mesh than step {}; geometry is encoded once",
                of_step.path.display(),
                opened.step
            )));
        }
        let step = FieldStep {
            number: number as u32,
            time: times.get(number).copied().unwrap_or(number as f64),
        };
        fields.extend(load(&of_step, wanted, Some(step))?);
    }
    Ok(fields)
}

fn choices(
    dataset: &Dataset,
    wanted: Option<&[String]>,
    with_notes: bool,
) -> Result<Vec<Choice>, Failure> {
    let Some(wanted) = wanted else {
        let all = dataset.fields().iter().enumerate().map(|(i, field)| {
            let component = ComponentChoice::Auto;
            if field.components() > 1 && with_notes {
                let name = field.name();
                eprintln!(
                    "note: field `{name}` has {} components; its magnitude is packed (--fields {name}:0 packs the first, {name}:all each and the magnitude)",
                    field.components()
                );
            }
            (field.name().to_owned(), FieldChoice::Index(i), component)
        });
        return Ok(all.collect());
    };
    let mut found = Vec::new();
    for text in wanted.iter().filter(|text| !text.is_empty()) {
        let is_field = |name: &str| dataset.fields().iter().any(|f| f.name() == name);
        let (name, component) = match text.rsplit_once(':') {
            Some((name, component)) if !is_field(text) => (name, Some(component)),
            _ => (text.as_str(), None),
        };
        let choice = FieldChoice::Name(name.to_owned());
        let field = dataset
            .field(&choice)
            .map_err(|e| Failure::Other(Box::new(e)))?;
        match component {
            None => found.push((text.clone(), choice, ComponentChoice::Auto)),
            Some("all") => {
                found.push((name.to_owned(), choice.clone(), ComponentChoice::Auto));
                let each = 0..field.components();
                found.extend(each.map(|i| {
                    let component = ComponentChoice::Index(i);
                    (format!("{name}:{i}"), choice.clone(), component)
                }));
            }
            Some(component) => {
                let component = values::component(component)
                    .map_err(|e| Wrong(format!("--fields {text}: {e}, or `all`")))?;
                found.push((text.clone(), choice, component));
            }
        }
    }
    Ok(found)
}
