//! What OME-Zarr says of images: their axes, the resolutions that there are, and where they lie. Source: the
//! OME-NGFF specifications, versions 0.1 to 0.5.

use serde_json::Value;

use super::wrong;
use crate::error::Problem;

/// An axis of an image.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Axis {
    /// Its name, lower case.
    pub name: String,
    /// What it is: `space`, `time`, `channel`, if that is said.
    pub kind: Option<String>,
    pub unit: Option<String>,
}

/// A resolution of an image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Level {
    /// Folder of its array, from the image's.
    pub path: String,
    /// Distance of numbers along each axis, and the place of the first.
    pub scale: Vec<f64>,
    pub translation: Vec<f64>,
}

/// An image of one or more resolutions, finest first.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Image {
    pub axes: Vec<Axis>,
    pub levels: Vec<Level>,
    /// Names of its channels.
    pub channels: Vec<Option<String>>,
}

/// Where a group's attributes have what OME says.
pub(super) fn of_attributes(attributes: &Value) -> &Value {
    match &attributes["ome"] {
        Value::Object(_) => &attributes["ome"],
        _ => attributes,
    }
}

impl Image {
    /// The first image that a group's attributes describe; `None` if there is none.
    ///
    /// # Errors
    /// [`Problem`] naming the member that is wrong or not supported.
    pub fn of(attributes: &Value) -> Result<Option<Self>, Problem> {
        let ome = of_attributes(attributes);
        let Some(image) = ome["multiscales"].as_array().and_then(|all| all.first()) else {
            return Ok(None);
        };
        let axes = axes(&image["axes"])?;
        let levels = image["datasets"].as_array().filter(|all| !all.is_empty());
        let levels = levels.ok_or_else(|| wrong("datasets", "at least one", image))?;
        let of_all = Transform::read(&image["coordinateTransformations"], axes.len())?;
        let levels = levels.iter().map(|level| {
            let path = level["path"].as_str().filter(|path| is_inside(path));
            let path = path.ok_or_else(|| wrong("path", "a folder of the image", level))?;
            let own = Transform::read(&level["coordinateTransformations"], axes.len())?;
            let whole = own.then(&of_all);
            Ok(Level {
                path: path.to_owned(),
                scale: whole.scale,
                translation: whole.translation,
            })
        });
        let levels = levels.collect::<Result<Vec<_>, Problem>>()?;
        let channels = ome["omero"]["channels"].as_array();
        let name = |channel: &Value| channel["label"].as_str().map(str::to_owned);
        Ok(Some(Self {
            levels,
            channels: channels.map_or(Vec::new(), |all| all.iter().map(name).collect()),
            axes,
        }))
    }
}

/// Whether a path leads to a folder within.
fn is_inside(path: &str) -> bool {
    let path = std::path::Path::new(path);
    let mut parts = path.components();
    !path.as_os_str().is_empty() && parts.all(|p| matches!(p, std::path::Component::Normal(_)))
}

fn axes(value: &Value) -> Result<Vec<Axis>, Problem> {
    let named = |name: &str| Axis {
        name: name.to_lowercase(),
        ..Axis::default()
    };
    let Some(all) = value.as_array() else {
        // Before version 0.3 all images had these.
        return Ok(["t", "c", "z", "y", "x"].map(named).to_vec());
    };
    let axis = |value: &Value| {
        let text = |key: &str| value[key].as_str().map(str::to_owned);
        match (value.as_str(), text("name")) {
            (Some(name), _) => Ok(named(name)),
            (None, Some(name)) => Ok(Axis {
                kind: text("type"),
                unit: text("unit"),
                ..named(&name)
            }),
            _ => Err(wrong("axes", "axes with names", value)),
        }
    };
    all.iter().map(axis).collect()
}

/// A scale along each axis, then a translation.
struct Transform {
    scale: Vec<f64>,
    translation: Vec<f64>,
}

impl Transform {
    fn read(value: &Value, num_axes: usize) -> Result<Self, Problem> {
        let mut all = Self {
            scale: vec![1.0; num_axes],
            translation: vec![0.0; num_axes],
        };
        for step in value.as_array().into_iter().flatten() {
            let numbers = |key: &str| {
                let place = &step[key];
                let numbers = place.as_array().filter(|all| all.len() == num_axes);
                let finite = |v: &Value| v.as_f64().filter(|n| n.is_finite());
                numbers
                    .and_then(|all| all.iter().map(finite).collect::<Option<Vec<f64>>>())
                    .ok_or_else(|| wrong(key, &format!("{num_axes} numbers"), step))
            };
            let next = match step["type"].as_str() {
                Some("identity") => continue,
                Some("scale") => Self {
                    scale: numbers("scale")?,
                    translation: vec![0.0; num_axes],
                },
                Some("translation") => Self {
                    scale: vec![1.0; num_axes],
                    translation: numbers("translation")?,
                },
                _ => {
                    let what = format!("the transformation {}", step["type"]);
                    return Err(Problem::unsupported(what));
                }
            };
            all = all.then(&next);
        }
        Ok(all)
    }

    /// This one, then another.
    fn then(&self, next: &Self) -> Self {
        let scale = self.scale.iter().zip(&next.scale);
        let moved = self
            .translation
            .iter()
            .zip(&next.scale)
            .zip(&next.translation);
        Self {
            scale: scale.map(|(a, b)| a * b).collect(),
            translation: moved.map(|((t, s), u)| t * s + u).collect(),
        }
    }
}
