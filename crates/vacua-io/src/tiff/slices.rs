//! The pages of one volume as a field.

use std::sync::Arc;

use rayon::prelude::*;
use vacua_volume::{ArrayError, Association, DataArray, Field, LoadError, ScalarType};

use super::directory::Container;
use super::page::Page;
use super::unpack::unpack;
use crate::decode::{Layout, decode_array};
use crate::error::Problem;

/// A page and its file.
#[derive(Clone)]
pub(super) struct Slice {
    /// The file.
    pub container: Arc<Container>,
    /// The page.
    pub page: Page,
}

impl Slice {
    /// Says which file has a problem, if it is not the one of the first slice.
    pub fn blame(&self, first: &Self, problem: Problem) -> Problem {
        if Arc::ptr_eq(&self.container, &first.container) {
            return problem;
        }
        Problem::part(problem.in_file(self.container.source.path()))
    }
}

/// The pages of one volume, all of one shape, at least one.
pub(super) struct Slices(Vec<Slice>);

impl Slices {
    /// Pages in the order of z.
    pub fn new(slices: Vec<Slice>) -> Self {
        Self(slices)
    }

    /// Where the numbers begin, if they lie in one piece of one file as they are.
    fn run_at(&self) -> Option<usize> {
        let first = &self.0[0];
        let page_bytes = first.page.shape.len_bytes()?;
        let mut next = first.page.run_at?;
        for slice in &self.0 {
            let is_here = Arc::ptr_eq(&slice.container, &first.container);
            if !is_here || slice.page.run_at != Some(next) {
                return None;
            }
            next = next.checked_add(page_bytes)?;
        }
        first.page.run_at
    }

    fn layout(&self) -> Result<Layout, Problem> {
        let Slice { container, page } = &self.0[0];
        let shape = page.shape;
        let too_large = || ArrayError::TooLarge {
            tuples: usize::MAX,
            components: shape.samples,
            scalar_type: shape.scalar_type,
        };
        let [width, height] = shape.size;
        let tuples = width
            .checked_mul(height)
            .and_then(|n| n.checked_mul(self.0.len()))
            .ok_or_else(too_large)?;
        let layout = Layout {
            scalar_type: shape.scalar_type,
            endianness: container.endianness,
            components: shape.samples,
            tuples,
        };
        layout.len_bytes().map(|_| layout)
    }

    /// The field, mapped if its numbers can be used where they are.
    ///
    /// # Errors
    /// [`Problem`] if there are more numbers than the address space has room for.
    pub fn into_field(self, name: &str) -> Result<Field, Problem> {
        let layout = self.layout()?;
        let is_half = self.0[0].page.shape.is_half;
        if self.run_at().is_some() && layout.is_native() && !is_half {
            return Ok(Field::new(name, Association::Point, self.fetch(&layout)?));
        }
        let scalar_type = match is_half {
            true => ScalarType::F32,
            false => layout.scalar_type,
        };
        let load = move || {
            self.fetch(&layout).map_err(|problem| {
                let path = self.0[0].container.source.path();
                Arc::new(problem.in_file(path)) as LoadError
            })
        };
        Ok(Field::lazy(
            name,
            Association::Point,
            scalar_type,
            layout.components,
            layout.tuples,
            load,
        ))
    }

    /// Maps or unpacks the numbers.
    fn fetch(&self, layout: &Layout) -> Result<DataArray, Problem> {
        let values = match self.run_at() {
            Some(at) => decode_array(&self.0[0].container.source, "the pages", at, layout)?,
            None => layout.fill_array(false, |bytes| {
                let page_bytes = bytes.len() / self.0.len();
                bytes
                    .par_chunks_exact_mut(page_bytes)
                    .zip(&self.0)
                    .try_for_each(|(to, slice)| {
                        unpack(&slice.page, &slice.container, to)
                            .map_err(|problem| slice.blame(&self.0[0], problem))
                    })
            })?,
        };
        if self.0[0].page.shape.is_half {
            return crate::npy::widen(&values);
        }
        Ok(values)
    }
}
