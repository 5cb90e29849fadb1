//! The XML of a file, with what stands for an element elsewhere in it.
//!
//! Two ways of saying so are understood, as programs write them: an element with
//! `Reference="/Xdmf/Domain/Grid[2]/Geometry"` (or `Reference="XML"` and the path as its text), and
//! `<xi:include xpointer="xpointer(//Grid[@Name='mesh']/*[self::Topology or self::Geometry])"/>`. Paths
//! have names, positions and attributes in brackets, `//` at their start, `*` and a choice by `self::`
//! at their end. Includes of other files are refused.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use crate::error::Problem;
use crate::files::{folder_of, resolve};
use crate::hdf5::Container;
use crate::source::Source;
use crate::vtk::xml::document::{Element, parse_markup};

/// Longest chain of references.
const MAX_HOPS: usize = 8;

/// Elements that a path may visit.
const MAX_VISITS: usize = 1 << 22;

/// A file with its markup read, and the HDF5 files that were opened for it.
pub(super) struct Document {
    /// The file.
    pub source: Source,
    /// Without a name, around `<Xdmf>`.
    top: Element,
    containers: Mutex<HashMap<PathBuf, Container>>,
}

impl Document {
    /// Reads the markup.
    ///
    /// # Errors
    /// [`Problem`] for broken XML or an unknown version.
    pub fn parse(source: &Source) -> Result<Self, Problem> {
        let markup = std::str::from_utf8(source.bytes()).map_err(|e| {
            Problem::malformed(
                format!("byte {}", e.valid_up_to()),
                "markup in UTF-8",
                "other bytes",
            )
        })?;
        let top = parse_markup(markup, false)?;
        let root = top.required_child("Xdmf")?;
        if let Some(version) = root.attribute("Version") {
            let major = version
                .trim()
                .split('.')
                .next()
                .and_then(|m| m.parse().ok());
            if !matches!(major, Some(1..=3u32)) {
                return Err(Problem::unsupported(format!("XDMF version `{version}`")));
            }
        }
        Ok(Self {
            source: source.clone(),
            top,
            containers: Mutex::new(HashMap::new()),
        })
    }

    /// The first domain.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if there is none.
    pub fn domain(&self) -> Result<&Element, Problem> {
        self.top.required_child("Xdmf")?.required_child("Domain")
    }

    /// The path of a file that this one names.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] if it leads out of the folder.
    pub fn path_of(&self, name: &str) -> Result<PathBuf, Problem> {
        resolve(&folder_of(self.source.path()), name)
    }

    /// An HDF5 file, opened once.
    ///
    /// # Errors
    /// [`Problem::Part`] if it cannot be opened.
    pub fn container(&self, path: &PathBuf) -> Result<Container, Problem> {
        let mut containers = self
            .containers
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if let Some(open) = containers.get(path) {
            return Ok(open.clone());
        }
        let source = Source::open(path).map_err(Problem::part)?;
        let open =
            Container::open(&source).map_err(|problem| Problem::part(problem.in_file(path)))?;
        containers.insert(path.clone(), open.clone());
        Ok(open)
    }

    /// All children of that name, those that are included among them.
    ///
    /// # Errors
    /// [`Problem`] if what one of them refers to is not there.
    pub fn children<'a>(
        &'a self,
        element: &'a Element,
        name: &str,
    ) -> Result<Vec<&'a Element>, Problem> {
        let mut found = Vec::new();
        for child in &element.children {
            if child.name == name {
                found.push(self.resolved(child)?);
            } else if child.name.rsplit(':').next() == Some("include") {
                let included = self.included(child)?;
                found.extend(included.into_iter().filter(|e| e.name == name));
            }
        }
        Ok(found)
    }

    /// The first child of that name.
    ///
    /// # Errors
    /// [`Problem`] if there is none, or what it refers to is not there.
    pub fn child<'a>(&'a self, element: &'a Element, name: &str) -> Result<&'a Element, Problem> {
        let found = self.children(element, name)?.first().copied();
        found.ok_or_else(|| {
            Problem::malformed(
                element.place(),
                format!("an element <{name}> in it"),
                "none",
            )
        })
    }

    /// What an element stands for: itself, or what it refers to.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if that is not there.
    pub fn resolved<'a>(&'a self, element: &'a Element) -> Result<&'a Element, Problem> {
        let mut at = element;
        for _ in 0..MAX_HOPS {
            let Some(reference) = at.attribute("Reference") else {
                return Ok(at);
            };
            let path = if reference.trim().eq_ignore_ascii_case("XML") {
                self.text(at)
            } else {
                reference.trim().to_owned()
            };
            let found = self.find(&path)?;
            at = found.first().copied().ok_or_else(|| {
                Problem::malformed(at.place(), format!("an element at `{path}`"), "none")
            })?;
        }
        Err(Problem::malformed(
            element.place(),
            format!("at most {MAX_HOPS} references one to the next"),
            "more",
        ))
    }

    fn included(&self, include: &Element) -> Result<Vec<&Element>, Problem> {
        if include
            .attribute("href")
            .is_some_and(|href| !href.is_empty())
        {
            return Err(Problem::unsupported(format!(
                "{}: the inclusion of another file",
                include.place()
            )));
        }
        let pointer = include.required("xpointer")?.trim();
        let path = pointer
            .strip_prefix("xpointer(")
            .and_then(|p| p.strip_suffix(')'))
            .ok_or_else(|| {
                Problem::unsupported(format!("{}: the pointer `{pointer}`", include.place()))
            })?;
        let found = self.find(path)?;
        if found.is_empty() {
            return Err(Problem::malformed(
                include.place(),
                format!("elements at `{path}`"),
                "none",
            ));
        }
        Ok(found)
    }

    /// The text of an element.
    pub fn text(&self, element: &Element) -> String {
        let bytes = self.source.bytes();
        let parts = element.text.iter().filter_map(|r| bytes.get(r.clone()));
        let parts: Vec<_> = parts.map(String::from_utf8_lossy).collect();
        parts.join(" ").trim().to_owned()
    }

    /// The elements at a path.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] for a path of another form.
    fn find(&self, path: &str) -> Result<Vec<&Element>, Problem> {
        let steps = Step::parse_all(path)?;
        let mut visits = MAX_VISITS;
        let mut at = vec![&self.top];
        for step in &steps {
            let mut next = Vec::new();
            for from in &at {
                step.select(from, &mut next, &mut visits);
            }
            at = next;
        }
        if visits == 0 {
            return Err(Problem::unsupported(format!(
                "the path `{path}`: it passes by more than {MAX_VISITS} elements"
            )));
        }
        Ok(at)
    }
}

/// One step of a path.
#[derive(Debug, PartialEq, Eq)]
struct Step {
    /// Names of elements; none for any.
    names: Vec<String>,
    /// Whether it leads to all descendants.
    is_deep: bool,
    /// Which of them: its number from 1.
    position: Option<usize>,
    /// An attribute and its value.
    attribute: Option<(String, String)>,
}

impl Step {
    fn parse_all(path: &str) -> Result<Vec<Self>, Problem> {
        let wrong = || Problem::unsupported(format!("the path `{path}`"));
        let mut rest = path.trim();
        let mut steps = Vec::new();
        while !rest.is_empty() {
            let is_deep = rest.starts_with("//");
            rest = rest
                .strip_prefix("//")
                .or_else(|| rest.strip_prefix('/'))
                .ok_or_else(wrong)?;
            // A slash in brackets or quotes belongs to the step.
            let mut depth = 0usize;
            let end = rest.find(|c| {
                match c {
                    '[' => depth += 1,
                    ']' => depth = depth.saturating_sub(1),
                    _ => {}
                }
                c == '/' && depth == 0
            });
            let (step, after) = rest.split_at(end.unwrap_or(rest.len()));
            steps.push(Self::parse(step, is_deep).ok_or_else(wrong)?);
            rest = after;
        }
        Ok(steps)
    }

    fn parse(text: &str, is_deep: bool) -> Option<Self> {
        let (name, mut rest) = text.split_at(text.find('[').unwrap_or(text.len()));
        let is_name =
            |n: &str| !n.is_empty() && n.chars().all(|c| c.is_alphanumeric() || "_:-".contains(c));
        let mut step = Self {
            names: match name.trim() {
                "*" => Vec::new(),
                name if is_name(name) => vec![name.to_owned()],
                _ => return None,
            },
            is_deep,
            position: None,
            attribute: None,
        };
        while !rest.is_empty() {
            let (inside, after) = rest.strip_prefix('[')?.split_once(']')?;
            let inside = inside.trim();
            if let Ok(position) = inside.parse() {
                step.position = Some(position);
            } else if let Some(equation) = inside.strip_prefix('@') {
                let (key, value) = equation.split_once('=')?;
                let value = value.trim();
                let value = ['"', '\'']
                    .iter()
                    .find_map(|&quote| value.strip_prefix(quote)?.strip_suffix(quote))?;
                step.attribute = Some((key.trim().to_owned(), value.to_owned()));
            } else {
                for choice in inside.split(" or ") {
                    let name = choice.trim().strip_prefix("self::")?;
                    step.names.push(name.trim().to_owned());
                }
            }
            rest = after;
        }
        Some(step)
    }

    fn select<'a>(&self, from: &'a Element, found: &mut Vec<&'a Element>, visits: &mut usize) {
        let before = found.len();
        for child in &from.children {
            *visits = visits.saturating_sub(1);
            if *visits == 0 {
                return;
            }
            let is_named = self.names.is_empty() || self.names.contains(&child.name);
            let has_value = self
                .attribute
                .as_ref()
                .is_none_or(|(key, value)| child.attribute(key) == Some(value));
            if is_named && has_value {
                found.push(child);
            }
        }
        if let Some(position) = self.position {
            let chosen = position
                .checked_sub(1)
                .and_then(|p| found.get(before + p))
                .copied();
            found.truncate(before);
            found.extend(chosen);
        }
        if self.is_deep {
            for child in &from.children {
                self.select(child, found, visits);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn document(text: &str) -> Document {
        let text = format!("<Xdmf Version=\"3.0\"><Domain>{text}</Domain></Xdmf>");
        let source = Source::from_bytes(Path::new("t.xdmf"), text.into_bytes());
        Document::parse(&source).expect("good markup")
    }

    #[test]
    fn paths_find_elements() {
        let document = document(
            "<Grid Name='a'><Topology/><Geometry Name='g1'/></Grid>\
             <Grid Name='b'><Grid Name='c/d'><Geometry Name='g2'/></Grid></Grid>",
        );
        let names = |path: &str| -> Vec<String> {
            let found = document.find(path).expect("a path");
            found
                .iter()
                .map(|e| e.attribute("Name").unwrap_or(&e.name).to_owned())
                .collect()
        };
        assert_eq!(names("/Xdmf/Domain/Grid"), ["a", "b"]);
        assert_eq!(names("/Xdmf/Domain/Grid[2]"), ["b"]);
        assert_eq!(names("/Xdmf/Domain/Grid[3]"), [""; 0]);
        assert_eq!(names("//Geometry"), ["g1", "g2"]);
        assert_eq!(names("//Grid[@Name='c/d']/Geometry[1]"), ["g2"]);
        let both = "//Grid[@Name=\"a\"]/*[self::Topology or self::Geometry]";
        assert_eq!(names(both), ["Topology", "g1"]);
        for wrong in ["Grid", "/Grid[", "/Grid[x]", "/G(1)", "/Grid[@Name=a]"] {
            assert!(document.find(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn references_are_followed_and_end() {
        let document = document(
            "<Grid><Geometry Reference='/Xdmf/Domain/Geometry'/>\
             <Topology Reference='XML'> /Xdmf/Domain/Topology[1] </Topology>\
             <Time Reference='/Xdmf/Domain/Grid/Time'/>\
             <Attribute Reference='/Xdmf/None'/></Grid>\
             <Geometry Name='there'/><Topology Name='here'/>",
        );
        let grid = document
            .domain()
            .and_then(|d| d.required_child("Grid"))
            .expect("there");
        for (kind, name) in [("Geometry", "there"), ("Topology", "here")] {
            let found = document.child(grid, kind).expect("there");
            assert_eq!(found.attribute("Name"), Some(name));
        }
        for kind in ["Time", "Attribute"] {
            assert!(document.child(grid, kind).is_err(), "{kind}");
        }
    }
}
