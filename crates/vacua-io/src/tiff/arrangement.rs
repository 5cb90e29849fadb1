//! Which page is which slice of which channel at which time, and how far apart they are.

use std::ops::Range;

/// How the pages of a file make volumes.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Arrangement {
    /// Slices a volume.
    pub slices: usize,
    /// Volumes at each time.
    pub channels: usize,
    /// Times.
    pub frames: usize,
    /// The page, counted from 0, of slice `z`, channel `c`, frame `t`, at place
    /// `z + slices × (c + channels × t)`.
    pub pages: Vec<usize>,
    /// Distance of pixels, rows and slices where the file says it, in its unit.
    pub spacing: [Option<f64>; 3],
    /// The file's unit of length.
    pub unit: Option<String>,
    /// Names of the channels that have one.
    pub channel_names: Vec<Option<String>>,
    /// Time between frames where the file says it, in its unit.
    pub interval: Option<f64>,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl Arrangement {
    /// One slice after the other.
    pub fn slices(num_pages: usize) -> Self {
        Self {
            slices: num_pages,
            channels: 1,
            frames: 1,
            pages: (0..num_pages).collect(),
            ..Self::default()
        }
    }

    /// Where in `pages` those of one volume are.
    pub fn volume(&self, channel: usize, frame: usize) -> Range<usize> {
        let first = self.slices * (channel + self.channels * frame);
        first..first + self.slices
    }

    /// The times of the frames; their numbers if the file does not say.
    pub fn times(&self) -> Vec<f64> {
        let interval = self.interval.unwrap_or(1.0);
        (0..self.frames).map(|t| t as f64 * interval).collect()
    }
}
