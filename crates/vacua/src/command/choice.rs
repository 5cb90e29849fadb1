//! Which field of a dataset, and what its values look like.

use std::path::{Path, PathBuf};

use vacua_io::transfer_json::read_transfer_function;
use vacua_render::SceneData;
use vacua_volume::{
    Association, Bounds, ComponentChoice, Dataset, Field, FieldChoice, OpacityPoint, ScalarType,
    TransferFunction, TransferStyle, ValueRange, ValueScale, Volume, default_unit_length,
};

use super::input::Opened;
use super::values::{self, OpacityList};
use super::{Failure, Wrong};

/// Which field, and which component of it.
#[derive(clap::Args, Debug)]
pub struct FieldArgs {
    /// Field by name, or by number as `#0` [default: the first of floating-point numbers, on points and
    /// with one component if there is such a one]
    #[arg(long, value_name = "NAME|#N", value_parser = values::field)]
    pub field: Option<FieldChoice>,
    /// Component of a field with several, from 0, or `mag` for the magnitude [default: mag]
    #[arg(long, value_name = "N|mag", value_parser = values::component)]
    pub component: Option<ComponentChoice>,
}

/// What the choice of a field without a name looks at.
pub struct Candidate<'a> {
    /// Its name.
    pub name: &'a str,
    /// Type of a number.
    pub scalar_type: ScalarType,
    /// On points or on cells.
    pub association: Association,
    /// Number of components.
    pub components: usize,
}

impl Candidate<'_> {
    /// How likely it is what one wants to see: integers beside floating-point numbers are mostly
    /// identifiers.
    fn likelihood(&self) -> (bool, bool, bool) {
        let is_float = matches!(self.scalar_type, ScalarType::F32 | ScalarType::F64);
        let is_on_points = self.association == Association::Point;
        (is_float, is_on_points, self.components == 1)
    }
}

impl FieldArgs {
    /// The field that is meant among those of a file. Without a name the first of the likeliest; a note
    /// says so if there are others.
    pub fn choice(&self, path: &Path, candidates: &[Candidate]) -> FieldChoice {
        if let Some(choice) = &self.field {
            return choice.clone();
        }
        if candidates.len() < 2 {
            return FieldChoice::Only;
        }
        let likeliest = candidates.iter().map(Candidate::likelihood).max();
        let is_likeliest = |c: &Candidate| Some(c.likelihood()) == likeliest;
        let chosen = candidates.iter().position(is_likeliest).unwrap_or(0);
        let others = candidates.iter().enumerate().filter(|&(i, _)| i != chosen);
        let others: Vec<&str> = others.map(|(_, c)| c.name).collect();
        eprintln!(
            "note: {}: field `{}` is taken; --field takes another ({})",
            path.display(),
            candidates[chosen].name,
            others.join(", ")
        );
        FieldChoice::Index(chosen)
    }

    /// Loads the chosen field.
    pub fn volume(&self, opened: &Opened) -> Result<Volume, Failure> {
        let fields = opened.dataset.fields().iter();
        let candidates: Vec<Candidate> = fields
            .map(|field| Candidate {
                name: field.name(),
                scalar_type: field.scalar_type(),
                association: field.association(),
                components: field.components(),
            })
            .collect();
        opened
            .dataset
            .volume(
                &self.choice(&opened.path, &candidates),
                self.component.unwrap_or_default(),
            )
            .map_err(|e| Failure::contents(&opened.path, e))
    }

    /// The dataset with the chosen field or component alone; as it is without a choice.
    pub fn dataset(&self, opened: &Opened) -> Result<Dataset, Failure> {
        let dataset = &opened.dataset;
        if self.field.is_none() && self.component.is_none() {
            return Ok(dataset.clone());
        }
        let fail = |e| Failure::contents(&opened.path, e);
        let field = match self.component {
            None => dataset
                .field(self.field.as_ref().unwrap_or(&FieldChoice::Only))
                .map_err(fail)?
                .clone(),
            Some(_) => {
                let volume = self.volume(opened)?;
                Field::new(
                    volume.name(),
                    volume.association(),
                    volume.scalars().clone(),
                )
            }
        };
        dataset.clone().with_fields(vec![field]).map_err(fail)
    }
}

/// What values look like.
#[derive(clap::Args, Debug)]
#[command(next_help_heading = "How it looks")]
pub struct LookArgs {
    /// Colour map by name, such as viridis, cool-warm or grey [default: viridis]
    #[arg(long, value_name = "NAME", value_parser = color_map)]
    pub colormap: Option<String>,
    /// Values that the colours span [default: 2nd to 98th percentile of the data]
    #[arg(long, value_name = "LO,HI", value_parser = values::range, allow_hyphen_values = true)]
    pub range: Option<ValueRange>,
    /// Opacity by value, in units of the data [default: a ramp from 0]
    #[arg(long, value_name = "V:A,V:A,…", allow_hyphen_values = true)]
    pub opacity: Option<OpacityList>,
    /// World length over which opacities hold [default: longest side of the data ÷ 100]
    #[arg(long, value_name = "LEN", value_parser = values::positive)]
    pub unit: Option<f64>,
    /// Transfer function from a JSON file, vacua's or ParaView's; other flags change it
    #[arg(long, value_name = "FILE", conflicts_with = "colormap")]
    pub tf: Option<PathBuf>,
    /// Spread values logarithmically
    #[arg(long, conflicts_with = "tf")]
    pub log: bool,
}

/// The name of a colour map that there is.
fn color_map(name: &str) -> Result<String, vacua_volume::presets::UnknownPreset> {
    let any = ValueRange { lo: 0.0, hi: 1.0 };
    vacua_volume::presets::color_points(name, any).map(|_| name.to_owned())
}

impl LookArgs {
    /// The transfer function for data.
    pub fn transfer_function(&self, data: &SceneData) -> Result<TransferFunction, Failure> {
        match &self.tf {
            Some(path) => self.read_file(path, data.bounds()),
            None => self
                .style()
                .resolve_for(&data.typical_scalars(), data.bounds())
                .map_err(|e| Failure::Other(Box::new(e))),
        }
    }

    fn style(&self) -> TransferStyle {
        let mut style = TransferStyle {
            range: self.range,
            unit_length: self.unit,
            scale: if self.log {
                ValueScale::Log
            } else {
                ValueScale::Linear
            },
            ..TransferStyle::default()
        };
        if let Some(name) = &self.colormap {
            style.color_map.clone_from(name);
        }
        match &self.opacity {
            Some(list) => style.opacity_points(list.0.clone()),
            None => style,
        }
    }

    fn read_file(&self, path: &Path, bounds: Bounds) -> Result<TransferFunction, Failure> {
        let unit = default_unit_length(bounds);
        let file = read_transfer_function(path, unit)?;
        for note in &file.notes {
            eprintln!("note: {}: {note}", path.display());
        }
        let fail = |e| Failure::contents(path, e);
        let mut function = file.function;
        if let Some(range) = self.range {
            function = function.stretched_to(range).map_err(fail)?;
        }
        let opacities: Vec<OpacityPoint> = match &self.opacity {
            Some(list) => list.0.clone(),
            None => function.opacities().to_vec(),
        };
        TransferFunction::new(
            function.colors().to_vec(),
            opacities,
            self.unit.unwrap_or(function.unit_length()),
            function.scale(),
        )
        .map_err(fail)
    }

    /// Checks what can be checked without data.
    pub fn check(&self) -> Result<(), Wrong> {
        match self.range {
            Some(range) if self.log && range.lo <= 0.0 => Err(Wrong(format!(
                "--log needs positive values, --range starts at {}",
                range.lo
            ))),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_not_what_is_shown() {
        let candidate = |name, scalar_type, association, components| Candidate {
            name,
            scalar_type,
            association,
            components,
        };
        let ids = candidate("ids", ScalarType::I64, Association::Point, 1);
        let velocity = candidate("velocity", ScalarType::F32, Association::Point, 3);
        let strain = candidate("strain", ScalarType::F64, Association::Cell, 1);
        let heat = candidate("heat", ScalarType::F32, Association::Point, 1);
        let args = FieldArgs {
            field: None,
            component: None,
        };
        let path = Path::new("a file");
        let chosen = |candidates: &[Candidate]| args.choice(path, candidates);
        assert_eq!(chosen(&[]), FieldChoice::Only);
        let all = [ids, strain, velocity, heat];
        assert_eq!(chosen(&all[..1]), FieldChoice::Only);
        assert_eq!(chosen(&all[..2]), FieldChoice::Index(1));
        assert_eq!(chosen(&all[..3]), FieldChoice::Index(2));
        assert_eq!(chosen(&all), FieldChoice::Index(3));
    }
}
