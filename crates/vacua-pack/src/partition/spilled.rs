//! The same split with the cells on disk: level by level until what is left fits in memory.

use std::io;

use super::{Entry, Group, Id, LeftOut, MAX_CELLS, MAX_SAH_DEPTH, Plane, Splitter, is_sampled};
use crate::spill::{SpillFolder, SpillWriter, Spilled};

/// Cells whose centres are found at a time.
const PIECE: usize = 1 << 18;

/// Why cells cannot be split on disk.
#[derive(Debug, thiserror::Error)]
pub enum SplitError {
    /// The temporary files.
    #[error("a temporary file beside the output: {0}")]
    Io(#[from] io::Error),
    /// One sub-mesh is larger than what may be in memory.
    #[error(
        "a sub-mesh of {cells} cells, the memory budget allows {most} at a time; use fewer index bits or more memory"
    )]
    PartTooLarge {
        /// Its cells.
        cells: u64,
        /// How many may be in memory.
        most: usize,
    },
}

impl Splitter<'_, '_> {
    /// Splits with at most so many cells in memory, and gives parts in order, some at a time.
    ///
    /// # Errors
    /// [`SplitError`], or what `each` fails with.
    pub fn split_on_disk<E: From<SplitError>>(
        &self,
        most: usize,
        folder: &SpillFolder,
        each: &mut impl FnMut(Group) -> Result<(), E>,
    ) -> Result<LeftOut, E> {
        let mut left_out = LeftOut::default();
        let all = self.spill_all(folder, &mut left_out);
        self.split_list(all.map_err(SplitError::Io)?, 0, most, folder, each)?;
        Ok(left_out)
    }

    fn spill_all(&self, folder: &SpillFolder, left_out: &mut LeftOut) -> io::Result<Spilled> {
        let mut list = SpillWriter::new(folder)?;
        let num_cells = self.input.mesh().num_cells();
        for start in (0..num_cells).step_by(PIECE) {
            let (entries, out) = self.entries::<u64>(start..(start + PIECE).min(num_cells));
            left_out.num_blanked += out.num_blanked;
            left_out.num_not_finite += out.num_not_finite;
            for e in entries {
                list.push((e.center, e.cell))?;
            }
        }
        list.finish()
    }

    fn split_list<E: From<SplitError>>(
        &self,
        mut list: Spilled,
        depth: usize,
        most: usize,
        folder: &SpillFolder,
        each: &mut impl FnMut(Group) -> Result<(), E>,
    ) -> Result<(), E> {
        if list.len <= most as u64 {
            let group = if self.input.mesh().num_cells() as u64 <= 1 << 32 {
                load::<u32>(&mut list).map(|entries| self.group(entries, depth))
            } else {
                load::<u64>(&mut list).map(|entries| self.group(entries, depth))
            };
            drop(list);
            return each(group.map_err(SplitError::Io)?);
        }
        if self.list_fits(&mut list).map_err(SplitError::Io)? {
            let cells = list.len;
            return Err(SplitError::PartTooLarge { cells, most }.into());
        }
        let halves = divide(&mut list, depth, folder).map_err(SplitError::Io)?;
        drop(list);
        for half in halves {
            self.split_list(half, depth + 1, most, folder, each)?;
        }
        Ok(())
    }

    /// Whether the cells of a list have few enough vertices.
    fn list_fits(&self, list: &mut Spilled) -> io::Result<bool> {
        if list.len > MAX_CELLS as u64 {
            return Ok(false);
        }
        self.sets.with(|points| {
            points.clear(self.input.mesh().num_points());
            let mut fits = true;
            list.visit(|(_, cell)| {
                fits = self.has_room(cell, points);
                Ok(fits)
            })?;
            Ok(fits)
        })
    }
}

fn load<I: Id>(list: &mut Spilled) -> io::Result<Vec<Entry<I>>> {
    let mut entries = Vec::with_capacity(list.len as usize);
    list.visit(|(center, cell)| {
        let cell = I::from_u64(cell);
        entries.push(Entry { center, cell });
        Ok(true)
    })?;
    Ok(entries)
}

/// Two lists in the order of the input, as a list in memory would be divided.
fn divide(list: &mut Spilled, depth: usize, folder: &SpillFolder) -> io::Result<[Spilled; 2]> {
    let len = list.len;
    let mut plane = None;
    if depth < MAX_SAH_DEPTH {
        let mut centers = Vec::new();
        list.visit(|(center, cell)| {
            if is_sampled(cell, len) {
                centers.push(center);
            }
            Ok(true)
        })?;
        plane = Plane::best(&centers);
    }
    let (mut left, mut right) = (SpillWriter::new(folder)?, SpillWriter::new(folder)?);
    let mut place = 0;
    list.visit(|(center, cell)| {
        let is_left = match &plane {
            Some(plane) => plane.is_left(&center),
            None => place < len / 2,
        };
        place += 1;
        let side = if is_left { &mut left } else { &mut right };
        side.push((center, cell))?;
        Ok(true)
    })?;
    Ok([left.finish()?, right.finish()?])
}
