//! A VTK XML file: its elements with their attributes, and where its data begins.
//!
//! The markup of a VTK file is read whole; the text inside elements is only located, since it may
//! be gigabytes of numbers. `<AppendedData>` ends the markup: what follows need not be text.
//!
//! VTK does not escape what it writes into attributes (`ComponentName0="a & <b>"`); such values
//! are taken as they stand.

use std::ops::Range;

use memchr::memmem;
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::codec::Compressor;
use crate::error::Problem;
use crate::source::Source;

/// Deepest nesting that is read; VTK's own files stay below ten.
const MAX_DEPTH: usize = 32;

/// Most elements that are read.
const MAX_ELEMENTS: usize = 1 << 20;

/// Longest `<AppendedData …>` tag.
const MAX_TAG_BYTES: usize = 4096;

/// One element: name, attributes, children, and where its own text is.
#[derive(Clone, Debug, Default)]
pub(crate) struct Element {
    /// Its name.
    pub name: String,
    /// Its attributes, in file order.
    pub attributes: Vec<(String, String)>,
    /// The elements within it, in file order.
    pub children: Vec<Element>,
    /// Where in the file its own text is, without that of its children; blank parts left out.
    pub text: Vec<Range<usize>>,
    /// Byte of the file after its opening tag's `<`.
    pub byte: usize,
}

impl Element {
    /// Where it is, for messages.
    pub fn place(&self) -> String {
        format!("element <{}> at byte {}", self.name, self.byte)
    }

    /// An attribute, if it is there.
    pub fn attribute(&self, key: &str) -> Option<&str> {
        self.attributes
            .iter()
            .find(|(k, _)| k == key)
            .map(|(_, v)| v.as_str())
    }

    /// An attribute that must be there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is not.
    pub fn required(&self, key: &str) -> Result<&str, Problem> {
        self.attribute(key).ok_or_else(|| {
            Problem::malformed(
                self.place(),
                format!("an attribute `{key}`"),
                "none of that name",
            )
        })
    }

    /// An attribute that reads as a number or another type, if it is there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is there and does not.
    pub fn parsed<T: std::str::FromStr>(
        &self,
        key: &str,
        expected: &str,
    ) -> Result<Option<T>, Problem> {
        let parse = |text: &str| {
            text.trim().parse().map_err(|_| {
                Problem::malformed(
                    format!("attribute `{key}` of {}", self.place()),
                    expected,
                    format!("`{}`", text.chars().take(80).collect::<String>()),
                )
            })
        };
        self.attribute(key).map(parse).transpose()
    }

    /// An attribute of exactly `N` floating-point numbers, if it is there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is there and is not that.
    pub fn numbers<const N: usize>(&self, key: &str) -> Result<Option<[f64; N]>, Problem> {
        let Some(text) = self.attribute(key) else {
            return Ok(None);
        };
        text.split_whitespace()
            .map(|word| word.parse().ok())
            .collect::<Option<Vec<f64>>>()
            .and_then(|numbers| <[f64; N]>::try_from(numbers).ok())
            .map(Some)
            .ok_or_else(|| {
                Problem::malformed(
                    format!("attribute `{key}` of {}", self.place()),
                    format!("{N} numbers"),
                    format!("`{}`", text.chars().take(80).collect::<String>()),
                )
            })
    }

    /// The first child of that name.
    pub fn child(&self, name: &str) -> Option<&Element> {
        self.children.iter().find(|c| c.name == name)
    }

    /// The first child of that name, without the rest.
    pub fn take_child(self, name: &str) -> Option<Element> {
        self.children.into_iter().find(|c| c.name == name)
    }

    /// The first child of that name, which must be there.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if it is not.
    pub fn required_child(&self, name: &str) -> Result<&Element, Problem> {
        self.child(name).ok_or_else(|| {
            Problem::malformed(self.place(), format!("an element <{name}> in it"), "none")
        })
    }

    /// All children of that name.
    pub fn children_named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Element> {
        self.children.iter().filter(move |c| c.name == name)
    }
}

/// Width of the integers in front of binary data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum HeaderType {
    /// 4 bytes.
    U32,
    /// 8 bytes.
    U64,
}

impl HeaderType {
    /// Size of one integer in bytes.
    pub fn size_bytes(self) -> usize {
        match self {
            Self::U32 => 4,
            Self::U64 => 8,
        }
    }
}

/// How appended data is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AppendedEncoding {
    /// As it is.
    Raw,
    /// As base64 text.
    Base64,
}

/// Where appended data is.
#[derive(Clone, Debug)]
pub(crate) struct Appended {
    /// How it is stored.
    pub encoding: AppendedEncoding,
    /// From after the underscore to the end (raw: of the file, base64: of the element).
    pub range: Range<usize>,
}

/// A VTK XML file with its markup read. Arrays are decoded from it on demand
/// ([`DataArrayElement::read`](super::data_array::DataArrayElement::read)).
pub(crate) struct XmlFile {
    /// The file.
    pub source: Source,
    /// The element `<VTKFile>`.
    pub root: Element,
    /// Byte order of all binary data.
    pub big_endian: bool,
    /// Width of the integers in front of binary data.
    pub header_type: HeaderType,
    /// What compressed binary data, if anything.
    pub compressor: Option<Compressor>,
    /// Where appended data is, if there is any.
    pub appended: Option<Appended>,
}

impl XmlFile {
    /// Reads the markup.
    ///
    /// # Errors
    /// [`Problem::Malformed`] for broken XML or attributes without sense, [`Problem::Unsupported`]
    /// for a compressor or version that is not known.
    pub fn parse(source: &Source) -> Result<Self, Problem> {
        let bytes = source.bytes();
        let markup_end = memmem::find(bytes, b"<AppendedData");
        let markup = &bytes[..markup_end.unwrap_or(bytes.len())];
        let markup = std::str::from_utf8(markup).map_err(|e| {
            Problem::malformed(
                format!("byte {}", e.valid_up_to()),
                "markup in UTF-8",
                "other bytes",
            )
        })?;
        let root = parse_markup(markup, markup_end.is_some())?
            .take_child("VTKFile")
            .ok_or_else(|| Problem::malformed("the root element", "<VTKFile>", "something else"))?;
        let appended = markup_end.map(|at| find_appended(bytes, at)).transpose()?;
        let big_endian = match root.attribute("byte_order") {
            None | Some("LittleEndian") => false,
            Some("BigEndian") => true,
            Some(other) => {
                return Err(Problem::malformed(
                    "attribute `byte_order` of <VTKFile>",
                    "LittleEndian or BigEndian",
                    format!("`{other}`"),
                ));
            }
        };
        let header_type = match root.attribute("header_type") {
            None | Some("UInt32") => HeaderType::U32,
            Some("UInt64") => HeaderType::U64,
            Some(other) => {
                return Err(Problem::malformed(
                    "attribute `header_type` of <VTKFile>",
                    "UInt32 or UInt64",
                    format!("`{other}`"),
                ));
            }
        };
        let compressor = match root.attribute("compressor") {
            None | Some("") => None,
            Some(name) => Some(Compressor::from_name(name)?),
        };
        if let Some(version) = root.attribute("version") {
            let major = version
                .split('.')
                .next()
                .and_then(|m| m.trim().parse().ok());
            if !matches!(major, Some(0..=2u32)) {
                return Err(Problem::unsupported(format!("VTK XML version `{version}`")));
            }
        }
        Ok(Self {
            source: source.clone(),
            root,
            big_endian,
            header_type,
            compressor,
            appended,
        })
    }

    /// The `type` of the file (`ImageData`, `PRectilinearGrid` …) and the element of that name.
    ///
    /// # Errors
    /// [`Problem::Malformed`] if one of them is missing.
    pub fn data_set(&self) -> Result<&Element, Problem> {
        self.root.required_child(self.root.required("type")?)
    }
}

/// Reads elements until the end of the markup, as the children of one without a name; `is_cut` allows
/// one to be open there.
///
/// # Errors
/// [`Problem`] for broken XML, or more of it than any file has.
pub(crate) fn parse_markup(markup: &str, is_cut: bool) -> Result<Element, Problem> {
    let mut reader = Reader::from_str(markup);
    let mut open: Vec<Element> = vec![Element::default()];
    let mut num_elements = 0usize;
    loop {
        let event = reader.read_event().map_err(|e| {
            Problem::malformed(
                format!("byte {}", reader.error_position()),
                "well-formed XML",
                e.to_string(),
            )
        })?;
        if matches!(event, Event::Start(_) | Event::Empty(_)) {
            num_elements += 1;
            if num_elements > MAX_ELEMENTS || open.len() > MAX_DEPTH {
                return Err(Problem::unsupported(format!(
                    "a file of more than {MAX_ELEMENTS} elements or more than {MAX_DEPTH} deep"
                )));
            }
        }
        match event {
            Event::Start(tag) => open.push(element(markup, &tag)?),
            Event::Empty(tag) => {
                let done = element(markup, &tag)?;
                close(&mut open, done);
            }
            Event::End(_) => {
                if let Some(done) = open.pop().filter(|_| !open.is_empty()) {
                    close(&mut open, done);
                }
            }
            Event::Text(text) => locate_text(markup, &text, &mut open),
            Event::CData(text) => locate_text(markup, &text, &mut open),
            Event::Eof => break,
            _ => {}
        }
    }
    let num_open = open.len() - 1;
    if num_open > usize::from(is_cut) {
        return Err(Problem::malformed(
            format!("byte {}", markup.len()),
            format!("</{}>", open[num_open].name),
            "the end of the markup",
        ));
    }
    while open.len() > 1 {
        if let Some(done) = open.pop() {
            close(&mut open, done);
        }
    }
    Ok(open.pop().unwrap_or_default())
}

/// Puts a finished element into the one around it.
fn close(open: &mut [Element], done: Element) {
    if let Some(parent) = open.last_mut() {
        parent.children.push(done);
    }
}

/// Byte at which a slice of the markup starts within it.
fn position(markup: &str, part: &str) -> usize {
    (part.as_ptr() as usize).saturating_sub(markup.as_ptr() as usize)
}

/// Notes where text that is not blank lies.
fn locate_text(markup: &str, text: &str, open: &mut [Element]) {
    let trimmed = text.trim_ascii();
    if let Some(element) = open.last_mut().filter(|_| !trimmed.is_empty()) {
        let start = position(markup, trimmed);
        element.text.push(start..start + trimmed.len());
    }
}

/// An element from its opening tag.
fn element(markup: &str, tag: &BytesStart<'_>) -> Result<Element, Problem> {
    let byte = position(markup, tag);
    let mut attributes = Vec::new();
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|e| {
            Problem::malformed(
                format!("the tag at byte {byte}"),
                "well-formed attributes",
                e.to_string(),
            )
        })?;
        let value = attribute
            .normalized_value(XmlVersion::Implicit1_0)
            .unwrap_or_else(|_| attribute.value.clone());
        attributes.push((attribute.key.0.to_owned(), value.into_owned()));
    }
    Ok(Element {
        name: tag.name().0.to_owned(),
        attributes,
        byte,
        ..Element::default()
    })
}

/// Finds appended data from the place of its opening tag.
fn find_appended(bytes: &[u8], at: usize) -> Result<Appended, Problem> {
    let place = || format!("element <AppendedData> at byte {at}");
    let tag = &bytes[at..bytes.len().min(at + MAX_TAG_BYTES)];
    let tag_len = memchr::memchr(b'>', tag)
        .map(|end| end + 1)
        .ok_or_else(|| Problem::malformed(place(), "a tag that ends", "no `>`"))?;
    let tag = String::from_utf8_lossy(&tag[..tag_len]);
    let encoding = match Reader::from_str(&tag).read_event() {
        Ok(Event::Start(start)) => element(&tag, &start)?,
        _ => return Err(Problem::malformed(place(), "an opening tag", tag)),
    };
    let encoding = match encoding.attribute("encoding") {
        Some("raw") => AppendedEncoding::Raw,
        None | Some("base64") => AppendedEncoding::Base64,
        Some(other) => {
            return Err(Problem::malformed(
                place(),
                "encoding raw or base64",
                format!("`{other}`"),
            ));
        }
    };
    let rest = &bytes[at + tag_len..];
    let underscore = rest
        .iter()
        .position(|b| !b.is_ascii_whitespace())
        .filter(|&p| rest[p] == b'_')
        .ok_or_else(|| Problem::malformed(place(), "data after `_`", "no `_`"))?;
    let start = at + tag_len + underscore + 1;
    let end = match encoding {
        AppendedEncoding::Raw => bytes.len(),
        AppendedEncoding::Base64 => {
            memchr::memchr(b'<', &bytes[start..]).map_or(bytes.len(), |len| start + len)
        }
    };
    Ok(Appended {
        encoding,
        range: start..end,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn parse(text: &str) -> Result<XmlFile, Problem> {
        XmlFile::parse(&Source::from_bytes(Path::new("t.vti"), text.into()))
    }

    #[test]
    fn markup_as_vtk_writes_it() {
        let file = parse(
            r#"<?xml version="1.0"?>
            <!-- a note -->
            <VTKFile type="ImageData" version="1.0" byte_order="BigEndian" header_type="UInt64">
              <ImageData a="X & <Y>" b='&lt;c&gt;'><Value> 1 2 <K>7</K> 3 </Value><E/></ImageData>
              <AppendedData encoding="raw">
               _"#,
        )
        .expect("what VTK writes");
        assert!(file.big_endian);
        assert_eq!(file.header_type, HeaderType::U64);
        let data_set = file.data_set().expect("there");
        assert_eq!(data_set.attribute("a"), Some("X & <Y>"));
        assert_eq!(data_set.attribute("b"), Some("<c>"));
        let value = data_set.child("Value").expect("there");
        let text: Vec<_> = value
            .text
            .iter()
            .map(|r| &file.source.bytes()[r.clone()])
            .collect();
        assert_eq!(text, [&b"1 2"[..], b"3"]);
        assert!(data_set.child("E").is_some());
        let appended = file.appended.expect("there");
        assert_eq!(appended.range.start, file.source.len());
    }

    #[test]
    fn broken_markup_is_refused() {
        for bad in [
            "",
            "<a/>",
            "<VTKFile><a></VTKFile>",
            "<VTKFile><a>",
            "<VTKFile byte_order='Middle'/>",
            "<VTKFile header_type='UInt16'/>",
            "<VTKFile compressor='vtkNoSuch'/>",
            "<VTKFile version='9.0'/>",
            "<VTKFile><AppendedData encoding='raw'>x</AppendedData></VTKFile>",
            "<VTKFile><AppendedData encoding='rot13'>_x</AppendedData></VTKFile>",
            "<VTKFile><AppendedData",
        ] {
            assert!(parse(bad).is_err(), "{bad}");
        }
        let deep = format!("<VTKFile>{}", "<a>".repeat(1_000_000));
        assert!(matches!(parse(&deep), Err(Problem::Unsupported { .. })));
    }
}
