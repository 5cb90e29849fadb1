//! Fields added to a `.vacua` file, or swapped in it: values and ranges alone are made, everything else
//! is copied as it is.

use std::path::Path;
use std::time::Instant;

use vacua_io::{IoError, write_atomically};

use super::write::{FieldHead, header_of, layout_of, section_bytes, write_sections};
use super::*;
use crate::encode::EncodeOptions;
use crate::field::{PackFieldError, PackedField};
use crate::ids::Order;
use crate::packed::PackedMesh;

/// What became of the fields, by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UpdateReport {
    /// New ones.
    pub added: Vec<String>,
    /// Those of the same name and time step that were there.
    pub swapped: Vec<String>,
    /// Those that stay as they were.
    pub kept: Vec<String>,
    /// Values of the input.
    pub num_values: u64,
    /// Time to find the blocks of the map.
    pub map_secs: f64,
    /// Time to bring values into packed order and find their ranges.
    pub pack_secs: f64,
    /// Time to put the file together.
    pub write_secs: f64,
}

/// Why fields could not be added.
#[derive(Debug, thiserror::Error)]
pub enum UpdateError {
    /// The file has no map from packed to original order.
    #[error("written without the map from packed to original order")]
    NoMap,
    /// A field does not fit.
    #[error(transparent)]
    Field(#[from] PackFieldError),
    /// The file is damaged, or cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
}

/// Where a field of the new file comes from.
enum Origin {
    /// By its number in the file.
    Kept(u32),
    /// By its place among the new ones.
    New(usize),
}

impl PackedFile {
    /// Writes this file again with fields of the original mesh added, or in the place of those of the
    /// same name and time step. `mesh` is this file's; `path` may be that of the file.
    ///
    /// # Errors
    /// [`UpdateError`] if a field does not fit the mesh, or the file was written without the map.
    ///
    /// # Cost
    /// One pass over the new values and the indices of all cells for each field on points; and what
    /// the file takes to be copied. Sections that are copied are not checked again: their checksums
    /// stay what they were.
    pub fn update(
        &self,
        path: &Path,
        mesh: &PackedMesh,
        fields: &[FieldInput],
    ) -> Result<UpdateReport, UpdateError> {
        if self.find(MAP_POINTS, NO_FIELD).is_err() {
            return Err(UpdateError::NoMap);
        }
        let mut report = UpdateReport::default();
        let mut new: Vec<(PackedField, FieldLabel)> = Vec::new();
        let mut orders: Vec<(vacua_volume::Association, Order)> = Vec::new();
        for field in fields {
            let start = Instant::now();
            let known = orders.iter().position(|(of, _)| *of == field.association);
            let known = match known {
                Some(known) => known,
                None => {
                    let blocks = self.order(mesh, field.association);
                    let blocks = blocks.map_err(|p| p.in_file(&self.path))?;
                    orders.push((field.association, Order::Blocks(blocks)));
                    orders.len() - 1
                }
            };
            report.map_secs += start.elapsed().as_secs_f64();
            let start = Instant::now();
            let (association, order) = &orders[known];
            let (name, values) = (&field.name, &field.values);
            let packed = PackedField::pack_in_order(mesh, order, name, *association, values)?;
            new.push((packed, field.label.clone()));
            report.num_values += field.values.tuples() as u64;
            report.pack_secs += start.elapsed().as_secs_f64();
        }
        let start = Instant::now();
        self.write_updated(path, &new, &mut report)?;
        report.write_secs = start.elapsed().as_secs_f64();
        Ok(report)
    }

    fn write_updated(
        &self,
        path: &Path,
        new: &[(PackedField, FieldLabel)],
        report: &mut UpdateReport,
    ) -> Result<(), IoError> {
        let numbers = self.table.iter().filter(|e| e.kind == NAME);
        let numbers: Vec<u32> = numbers.map(|e| e.field).collect();
        let entries = self.fields()?;
        let step = |label: &FieldLabel| label.step.map(|s| s.number);
        let mut is_placed = vec![false; new.len()];
        let mut origins = Vec::new();
        for (entry, &number) in entries.iter().zip(&numbers) {
            let same = |(field, label): &(PackedField, FieldLabel)| {
                field.name() == entry.name && step(label) == step(&entry.label)
            };
            match new.iter().position(same) {
                Some(found) => {
                    is_placed[found] = true;
                    origins.push(Origin::New(found));
                    report.swapped.push(entry.name.clone());
                }
                None => {
                    origins.push(Origin::Kept(number));
                    report.kept.push(entry.name.clone());
                }
            }
        }
        for (place, (field, _)) in new.iter().enumerate() {
            if !is_placed[place] {
                origins.push(Origin::New(place));
                report.added.push(field.name().to_owned());
            }
        }
        let heads: Vec<FieldHead> = origins
            .iter()
            .enumerate()
            .map(|(i, origin)| match origin {
                Origin::Kept(_) => FieldHead::of_entry(&entries[i]),
                Origin::New(place) => FieldHead::of_packed(&new[*place].0, &new[*place].1),
            })
            .collect();
        let layout = layout_of(self.variant(), true, &heads);
        let mut pieces: Vec<&[u8]> = Vec::with_capacity(layout.len());
        let mut table = Vec::with_capacity(layout.len());
        for section in &layout {
            let origin = origins.get(section.field as usize);
            let copied = match (section.bytes, origin) {
                (Some(_), _) | (None, Some(Origin::New(_))) => None,
                (None, Some(Origin::Kept(number))) => Some(*number),
                (None, None) => Some(NO_FIELD),
            };
            let (bytes, sum) = match (copied, origin) {
                (Some(field), _) => {
                    let (_, entry) = self
                        .find(section.kind, field)
                        .map_err(|p| p.in_file(&self.path))?;
                    let place = entry.offset as usize..(entry.offset + entry.length) as usize;
                    let bytes = self.store.bytes().get(place).unwrap_or(&[]);
                    (bytes, entry.checksum)
                }
                (None, Some(Origin::New(place))) if section.bytes.is_none() => {
                    let bytes = section_bytes(section.kind, &new[*place].0);
                    (bytes, checksum(bytes))
                }
                (None, _) => {
                    let bytes = section.bytes.unwrap_or(&[]);
                    (bytes, checksum(bytes))
                }
            };
            table.push(section.entry(bytes.len() as u64, sum));
            pieces.push(bytes);
        }
        let options = EncodeOptions {
            variant: self.variant(),
            index_bits: self.header.index_bits,
        };
        let header = header_of(options, &mut table);
        write_atomically(path, |file| write_sections(file, &header, &table, &pieces))
    }
}
