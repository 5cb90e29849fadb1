//! Proxy boxes around the active macrocells (Ganter and Manzke 2019, as paper A §3 has it).

use std::time::Instant;

use vacua_skip::{ActiveMask, cluster_boxes};

use super::{BOX_NUMBERS, Outline, Pending, PendingOver, ShapesKey};
use crate::error::GpuError;
use crate::renderer::job::Job;
use crate::renderer::{GpuRenderer, Plan};
use crate::vulkan::{Buffer, Place, Timings};

impl GpuRenderer {
    /// Clusters the active macrocells on the host, and sends the boxes.
    pub(super) fn new_boxes(
        &mut self,
        job: &mut Job,
        plan: Plan,
        shapes: ShapesKey,
        older: Option<Outline>,
        timings: &mut Timings,
    ) -> Result<Pending, GpuError> {
        let steps = self.steps(job, plan)?;
        let len = job.lattice.len();
        let mask = Buffer::new(&self.device, "the mask", len as u64, Place::Download)?;
        self.run_first(job, &steps, plan, timings, |recorder, known| {
            recorder.stage("mask", |r| {
                if let Some(cells) = known.cells {
                    r.copy(&cells.maps[0], &mask, 0, len as u64);
                }
            });
        })?;
        let start = Instant::now();
        let mut active = ActiveMask::inactive(job.lattice.counts());
        let [nx, ny, _] = job.lattice.counts();
        for (i, _) in mask.bytes()[..len]
            .iter()
            .enumerate()
            .filter(|(_, b)| **b == 0)
        {
            active.set([i % nx, i / nx % ny, i / (nx * ny)], true);
        }
        let boxes = cluster_boxes(&active);
        timings.0.push(("cluster", start.elapsed().as_secs_f64()));
        let num = u32::try_from(boxes.len()).unwrap_or(u32::MAX);
        let capacity = num.max(1);
        let size = 4 * (BOX_NUMBERS * capacity as usize) as u64;
        self.new_structures((job.key, shapes), (num, capacity), [size; 2], false, older)?;
        let wider = job.parameters.flange;
        // Both as they are and wider, one after the other; what there is no box for is far away.
        let mut numbers = vec![f32::MAX; 2 * BOX_NUMBERS * capacity as usize];
        let (exact, wide) = numbers.split_at_mut(BOX_NUMBERS * capacity as usize);
        for (i, corners) in boxes.iter().enumerate() {
            for (c, corner) in corners.iter().enumerate() {
                for (a, &plane) in corner.iter().enumerate() {
                    let at = BOX_NUMBERS * i + 3 * c + a;
                    exact[at] = job.lattice.plane(a, plane);
                    wide[at] = exact[at] + if c == 0 { -wider } else { wider };
                }
            }
        }
        let bytes: &[u8] = bytemuck::cast_slice(&numbers);
        let mut staging = Buffer::new(&self.device, "boxes", bytes.len() as u64, Place::Upload)?;
        staging.bytes_mut()[..bytes.len()].copy_from_slice(bytes);
        if let Some(outline) = &self.outline
            && let Some(corners) = outline.corners()
        {
            let sent = self.commands.run(&self.layout, |recorder| {
                recorder.stage("boxes", |r| {
                    r.copy(&staging, &outline.faces, 0, size);
                    r.copy_between((&staging, size), (corners, 0), size);
                });
                Ok(())
            })?;
            timings.0.extend(sent.0);
        }
        Ok(Pending {
            faces: None,
            over: PendingOver::Structures { is_update: false },
        })
    }
}
