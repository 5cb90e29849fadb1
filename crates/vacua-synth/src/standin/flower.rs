//! A stand-in for FLOWER (1024³ u8): whorls of thin petals around a stem and a seed head.
//!
//! A petal whorl is a thin cup `radius(height) · (1 + waves around the axis)` that ends where its
//! petals end. Waves of angle come from Chebyshev recurrences, not from trigonometry.

use std::ops::Range;

use crate::fill::Rows;

struct Whorl {
    /// Radius at the foot and gain towards the rim, in sides of the volume.
    radius: [f32; 2],
    /// Heights of foot, notch between petals and tip.
    heights: [f32; 3],
    /// Number of petals, as 2, 4 or 8.
    doublings: u32,
    /// Depth of the folds, as part of the radius.
    fold: f32,
    /// Turn against the x axis, as cosine and sine.
    turn: [f32; 2],
}

const WHORLS: [Whorl; 5] = [
    Whorl {
        radius: [0.05, 0.10],
        heights: [0.35, 0.66, 0.90],
        doublings: 1,
        fold: 0.25,
        turn: [1.0, 0.0],
    },
    Whorl {
        radius: [0.08, 0.19],
        heights: [0.32, 0.58, 0.88],
        doublings: 2,
        fold: 0.16,
        turn: [0.8, 0.6],
    },
    Whorl {
        radius: [0.10, 0.29],
        heights: [0.30, 0.48, 0.80],
        doublings: 2,
        fold: 0.14,
        turn: [0.28, 0.96],
    },
    Whorl {
        radius: [0.11, 0.36],
        heights: [0.28, 0.36, 0.60],
        doublings: 3,
        fold: 0.10,
        turn: [0.6, -0.8],
    },
    Whorl {
        radius: [0.02, 0.44],
        heights: [0.16, 0.24, 0.42],
        doublings: 2,
        fold: 0.08,
        turn: [-0.6, 0.8],
    },
];

/// Half the thickness of a petal, in sides of the volume.
const HALF_THICKNESS: f32 = 0.0145;

/// A flower along z in the unit cube, stretched to the volume.
pub(crate) struct Flower {
    step: [f32; 3],
    len: usize,
}

/// What the whorls, stem and seed head look like at one height.
pub(crate) struct FlowerSlice {
    /// For each whorl that is there: mean radius, fold, doublings, turn, and the cosine of the
    /// petal angle above which there is a petal at this height.
    rings: Vec<Ring>,
    stem: f32,
    head: f32,
    reach: f32,
}

struct Ring {
    radius: f32,
    fold: f32,
    doublings: u32,
    turn: [f32; 2],
    /// There is a petal where the wave is at least this.
    petal_from: f32,
}

impl Ring {
    /// Value at a place relative to the axis.
    #[inline(always)]
    fn value(&self, dx: f32, dy: f32) -> f32 {
        let distance = (dx * dx + dy * dy).sqrt();
        // cos(2φ) = 2cos²φ − 1, as often as there are doublings.
        let mut wave = (dx * self.turn[0] + dy * self.turn[1]) / distance.max(1e-6);
        for _ in 0..self.doublings {
            wave = 2.0 * wave * wave - 1.0;
        }
        let off = (distance - self.radius * (1.0 + self.fold * wave)).abs();
        let thickness = HALF_THICKNESS * ((wave - self.petal_from) * 6.0).clamp(0.0, 1.0);
        0.85 * (thickness - off) / HALF_THICKNESS
    }
}

impl Flower {
    pub fn new(points: [usize; 3]) -> Self {
        Self {
            step: points.map(|n| 1.0 / n as f32),
            len: points[0],
        }
    }
}

impl Rows for Flower {
    type Slice<'a> = FlowerSlice;

    fn slice(&self, z: usize) -> FlowerSlice {
        let height = (z as f32 + 0.5) * self.step[2];
        let rings: Vec<Ring> = WHORLS
            .iter()
            .filter(|w| (w.heights[0]..w.heights[2]).contains(&height))
            .map(|w| {
                let rise = (height - w.heights[0]) / (w.heights[2] - w.heights[0]);
                let above = (height - w.heights[1]) / (w.heights[2] - w.heights[1]);
                Ring {
                    radius: w.radius[0] + w.radius[1] * rise.sqrt(),
                    fold: w.fold * rise,
                    doublings: w.doublings,
                    turn: w.turn,
                    petal_from: if above > 0.0 { 2.0 * above - 1.0 } else { -1.0 },
                }
            })
            .collect();
        let head_sq = 0.07f32.powi(2) - 0.6 * (height - 0.36).powi(2);
        let stem = if height < 0.34 {
            0.025 + 0.01 * height
        } else {
            0.0
        };
        let head = head_sq.max(0.0).sqrt();
        let reach = rings
            .iter()
            .map(|r| r.radius * (1.0 + r.fold) + HALF_THICKNESS)
            .fold(stem.max(head), f32::max);
        FlowerSlice {
            rings,
            stem,
            head,
            reach,
        }
    }

    fn row(&self, slice: &mut FlowerSlice, y: usize, row: &mut [f32]) -> Range<usize> {
        let dy = (y as f32 + 0.5) * self.step[1] - 0.5;
        let half_sq = slice.reach * slice.reach - dy * dy;
        if half_sq <= 0.0 {
            return 0..0;
        }
        let half = half_sq.sqrt();
        let at = |x: f32| ((x / self.step[0]).max(0.0) as usize).min(self.len);
        let range = at(0.5 - half)..at(0.5 + half + self.step[0]);
        let row = &mut row[range.clone()];
        let x_of = |i: usize| ((range.start + i) as f32 + 0.5) * self.step[0] - 0.5;
        let head = slice.stem.max(slice.head);
        for (i, out) in row.iter_mut().enumerate() {
            let dx = x_of(i);
            *out = ((head - (dx * dx + dy * dy).sqrt()) / 0.03).clamp(0.0, 1.0);
        }
        for ring in &slice.rings {
            let outer = ring.radius * (1.0 + ring.fold) + HALF_THICKNESS;
            let inner = ring.radius * (1.0 - ring.fold) - HALF_THICKNESS;
            let half_width = |radius: f32| {
                let half = (radius * radius.abs() - dy * dy).max(0.0).sqrt();
                at(0.5 - half)..at(0.5 + half + self.step[0])
            };
            let (around, hole) = (half_width(outer), half_width(inner));
            // The left and the right part of the ring, or all of it where the hole is closed.
            let left = around.start..(hole.start + 1).clamp(around.start, around.end);
            let right = left.end.max(hole.end.saturating_sub(2))..around.end;
            for i in left.chain(right) {
                let i = i - range.start;
                row[i] = row[i].max(ring.value(x_of(i), dy));
            }
        }
        range
    }
}
