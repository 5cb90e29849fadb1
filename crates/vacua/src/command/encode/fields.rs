//! Which fields are encoded, of which time steps.

use vacua_pack::file::{FieldInput, FieldLabel, FieldStep, VectorComponent, VectorPart};
use vacua_volume::{ComponentChoice, Dataset, Field, FieldChoice, UnstructuredMesh};

use super::super::input::{InputArgs, Opened};
use super::super::{Failure, Wrong, output, values};

/// A field to be packed.
struct Choice {
    /// Its name there.
    name: String,
    field: FieldChoice,
    component: ComponentChoice,
    /// What it is a part of, if all parts are packed.
    vector: Option<VectorPart>,
}

/// Loads the fields that are asked for of the step that is open; all of them without a wish.
pub fn load(
    opened: &Opened,
    wanted: Option<&[String]>,
    step: Option<FieldStep>,
) -> Result<Vec<FieldInput>, Failure> {
    let dataset = &opened.dataset;
    let mut fields = Vec::new();
    for choice in choices(dataset, wanted)? {
        let name = choice.name;
        let volume = output::during(&format!("reading field `{name}`"), || {
            dataset
                .volume(&choice.field, choice.component)
                .map_err(|e| Failure::contents(&opened.path, e))
        })?;
        fields.push(FieldInput {
            name,
            association: volume.association(),
            values: volume.scalars().clone(),
            label: FieldLabel {
                step,
                vector: choice.vector,
            },
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

/// A field whole: the lone component, or the magnitude and each of several.
fn whole(field: &Field, choice: &FieldChoice) -> Vec<Choice> {
    let name = field.name();
    let part = |name: String, component, vector| Choice {
        name,
        field: choice.clone(),
        component,
        vector,
    };
    if field.components() == 1 {
        return vec![part(name.to_owned(), ComponentChoice::Auto, None)];
    }
    let of = |component| {
        let name = name.to_owned();
        Some(VectorPart { name, component })
    };
    let magnitude = of(VectorComponent::Magnitude);
    let magnitude = part(name.to_owned(), ComponentChoice::Magnitude, magnitude);
    let each = (0..field.components()).map(|i| {
        let vector = of(VectorComponent::Index(i as u32));
        part(format!("{name}:{i}"), ComponentChoice::Index(i), vector)
    });
    std::iter::once(magnitude).chain(each).collect()
}

/// What is packed; all fields whole without a wish.
fn choices(dataset: &Dataset, wanted: Option<&[String]>) -> Result<Vec<Choice>, Failure> {
    let Some(wanted) = wanted else {
        let all = dataset.fields().iter().enumerate();
        return Ok(all
            .flat_map(|(i, field)| whole(field, &FieldChoice::Index(i)))
            .collect());
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
            None | Some("all") => found.extend(whole(field, &choice)),
            Some(component) => {
                let component = values::component(component)
                    .map_err(|e| Wrong(format!("--fields {text}: {e}, or `all`")))?;
                found.push(Choice {
                    name: text.clone(),
                    field: choice,
                    component,
                    vector: None,
                });
            }
        }
    }
    Ok(found)
}
