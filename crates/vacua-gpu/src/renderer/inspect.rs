//! What the device has made on the way to a picture.

use std::sync::Arc;

use vacua_skip::Quad;

use super::GpuRenderer;
use super::job::SkipKey;
use super::outline::Outline;
use crate::error::GpuError;
use crate::shared::{FACE_NUMBERS, FACE_WORDS};
use crate::skip::DeviceMacrocells;
use crate::vulkan::{Buffer, Commands, Device, Layout, Place};

/// Faces of the boundary, and the corners of the two triangles of each.
pub type Boundary = (Vec<Quad>, Vec<[[f32; 3]; 6]>);

impl GpuRenderer {
    /// Bytes of what rays are traced against, and of the acceleration structure over it alone.
    pub fn outline_bytes(&self) -> [u64; 2] {
        let outline = self.outline.as_ref();
        outline.map_or([0; 2], Outline::size_bytes)
    }

    /// Faces of the boundary, or boxes, that rays are traced against.
    pub fn num_outlined(&self) -> usize {
        self.outline.as_ref().map_or(0, |o| o.num as usize)
    }

    /// The ranges of macrocells of a size as the device has them, for tests: lower and upper ends;
    /// `None` if they were never needed.
    ///
    /// # Errors
    /// What the driver says.
    pub fn ranges(&mut self, side: usize) -> Result<Option<Vec<[f32; 2]>>, GpuError> {
        let Some(cells) = self.macrocells.get(&side).filter(|m| m.is_ready) else {
            return Ok(None);
        };
        let len = 8 * cells.len() as usize;
        let bytes = self.read(&side, |m| &m.ranges, len)?;
        Ok(Some(bytemuck::pod_collect_to_vec(&bytes)))
    }

    /// The map of macrocells of the last picture that was made with one, as the device has it, for tests: a
    /// byte each, as `lattice.glsl` says.
    ///
    /// # Errors
    /// What the driver says.
    pub fn macrocell_map(&mut self) -> Result<Option<Vec<u8>>, GpuError> {
        let Some(SkipKey { side, .. }) = self.skip.filter(|_| self.has_distances) else {
            return Ok(None);
        };
        let len = self.macrocells.get(&side).map_or(0, DeviceMacrocells::len);
        Ok(Some(self.read(&side, |m| &m.maps[1], len as usize)?))
    }

    /// Which macrocells are active, as the device has it, for tests.
    ///
    /// # Errors
    /// What the driver says.
    pub fn active(&mut self) -> Result<Option<Vec<bool>>, GpuError> {
        let Some(SkipKey { side, .. }) = self.skip else {
            return Ok(None);
        };
        let len = self.macrocells.get(&side).map_or(0, DeviceMacrocells::len);
        let map = self.read(&side, |m| &m.maps[0], len as usize)?;
        Ok(Some(map.iter().map(|&distance| distance == 0).collect()))
    }

    /// The boundary of the last picture by `mesh` as the device has it, for tests: its faces, and the
    /// corners of their triangles, if there are any.
    ///
    /// # Errors
    /// What the driver says.
    pub fn boundary(&mut self) -> Result<Option<Boundary>, GpuError> {
        let outline = self.outline.as_ref();
        let Some(outline) = outline.filter(|o| o.is_boundary()) else {
            return Ok(None);
        };
        let num = outline.num as usize;
        let words = download(
            &self.device,
            &mut self.commands,
            &self.layout,
            (&outline.faces, 4 * FACE_WORDS as usize * num),
        )?;
        let corners = match outline.corners() {
            Some(corners) => download(
                &self.device,
                &mut self.commands,
                &self.layout,
                (corners, 4 * FACE_NUMBERS as usize * num),
            )?,
            None => Vec::new(),
        };
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&words);
        let quad = |face: &[u32]| Quad {
            axis: (face[0] & 3) as u8,
            faces_up: face[0] >> 2 & 1 == 1,
            plane: face[0] >> 3,
            at: [face[1], face[2]],
        };
        let faces = words.chunks_exact(FACE_WORDS as usize).map(quad).collect();
        let triangles = bytemuck::pod_collect_to_vec(&corners);
        Ok(Some((faces, triangles)))
    }

    fn read(
        &mut self,
        side: &usize,
        buffer: impl Fn(&DeviceMacrocells) -> &Buffer,
        len: usize,
    ) -> Result<Vec<u8>, GpuError> {
        let Some(cells) = self.macrocells.get(side) else {
            return Ok(Vec::new());
        };
        download(
            &self.device,
            &mut self.commands,
            &self.layout,
            (buffer(cells), len),
        )
    }
}

/// The first bytes of a buffer.
fn download(
    device: &Arc<Device>,
    commands: &mut Commands,
    layout: &Layout,
    (from, len): (&Buffer, usize),
) -> Result<Vec<u8>, GpuError> {
    let to = Buffer::new(device, "reading", from.size_bytes(), Place::Download)?;
    commands.run(layout, |recorder| {
        recorder.copy(from, &to, 0, from.size_bytes());
        recorder.barrier();
        Ok(())
    })?;
    Ok(to.bytes()[..len].to_vec())
}
