//! Pictures: linear light, premultiplied alpha, depth and cost, with the counters of their making.

/// One rendered picture, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear-light red, green, blue, premultiplied by alpha, and alpha.
    pub rgba: Vec<[f32; 4]>,
    /// World distance along the ray to the first sample at which alpha reaches ½ (maximum
    /// intensity: to the sample that is shown); infinite if there is none.
    pub depth: Vec<f32>,
    /// Samples evaluated for each pixel.
    pub samples: Vec<u32>,
}

impl Frame {
    /// A picture of nothing.
    pub fn empty(width: usize, height: usize) -> Self {
        let pixels = width * height;
        Self {
            width,
            height,
            rgba: vec![[0.0; 4]; pixels],
            depth: vec![f32::INFINITY; pixels],
            samples: vec![0; pixels],
        }
    }

    /// Samples evaluated in all.
    pub fn total_samples(&self) -> u64 {
        self.samples.iter().map(|&s| u64::from(s)).sum()
    }

    /// Whether every pixel is fully transparent.
    pub fn is_blank(&self) -> bool {
        self.rgba.iter().all(|p| p[3] == 0.0)
    }
}
