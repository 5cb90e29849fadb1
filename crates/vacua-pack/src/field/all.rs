//! All values of a field, whether they lie in an array or in frames.

use std::borrow::Cow;

use rayon::prelude::*;
use vacua_volume::{Association, DataArray, Scalar, ValueProfile, dispatch_scalar};

use super::PackedField;
use crate::layout::SubmeshHeader;
use crate::packed::PackedMesh;
use crate::small::{FramedValues, block_of_cell, block_of_vertex};

impl PackedField {
    /// What is known of all values together.
    ///
    /// Cost: looks at each value once.
    pub fn profile(&self, mesh: &PackedMesh) -> ValueProfile {
        let Some(framed) = &self.framed else {
            return self.values.profile(0);
        };
        mesh.submeshes()
            .par_iter()
            .map(|header| {
                let values = self.decoded(framed, std::iter::once(header), 1);
                values.map_or(ValueProfile::EMPTY, |values| values.profile(0))
            })
            .reduce(|| ValueProfile::EMPTY, ValueProfile::union)
    }

    /// The values: all of them, or, if they lie in frames and there are more than `most`, every so many
    /// of each sub-mesh.
    pub fn some_values(&self, mesh: &PackedMesh, most: usize) -> Cow<'_, DataArray> {
        let headers = mesh.submeshes();
        let decoded = self.framed.as_ref().and_then(|framed| {
            let count: u64 = headers.iter().map(|h| self.num_values(h)).sum();
            let every = count.div_ceil(most.max(1) as u64).max(1);
            self.decoded(framed, headers.iter(), every)
        });
        decoded.map_or(Cow::Borrowed(&self.values), Cow::Owned)
    }

    /// How many values a sub-mesh has.
    fn num_values(&self, header: &SubmeshHeader) -> u64 {
        match self.association {
            Association::Point => u64::from(header.num_vertices),
            Association::Cell => header.total_cells(),
        }
    }

    /// Every so many values of some sub-meshes.
    fn decoded<'a>(
        &self,
        framed: &FramedValues,
        headers: impl Iterator<Item = &'a SubmeshHeader>,
        every: u64,
    ) -> Option<DataArray> {
        dispatch_scalar!(framed.scalar_type(), T => {
            let values: Vec<T> = headers
                .flat_map(|header| self.every::<T>(framed, header, every))
                .collect();
            DataArray::from_vec(values, 1).ok()
        })
    }

    fn every<T: Scalar>(
        &self,
        framed: &FramedValues,
        header: &SubmeshHeader,
        every: u64,
    ) -> impl Iterator<Item = T> {
        let block_of = match self.association {
            Association::Point => block_of_vertex,
            Association::Cell => block_of_cell,
        };
        let places = (0..self.num_values(header)).step_by(usize::try_from(every).unwrap_or(1));
        // What a damaged file lacks is left out.
        places.map_while(move |place| {
            let place = u32::try_from(place).ok()?;
            framed.get::<T>(block_of(header, place), place as usize)
        })
    }
}
