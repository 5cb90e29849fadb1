//! Progressive refinement: the mean of frames whose rays differ (paper A §4.4).

use crate::frame::Frame;

/// Sums frames of one scene; [`Accumulator::mean`] is the picture so far.
#[derive(Clone, Debug)]
pub struct Accumulator {
    sum: Frame,
    frames: u32,
}

impl Accumulator {
    /// Begins with a first frame.
    pub fn new(first: Frame) -> Self {
        Self {
            sum: first,
            frames: 1,
        }
    }

    /// Adds a frame. Depth stays that of the first frame, costs add up.
    ///
    /// # Panics
    /// If the frame has another size.
    pub fn add(&mut self, frame: &Frame) {
        assert_eq!(
            (frame.width, frame.height),
            (self.sum.width, self.sum.height),
            "frames of one picture have one size"
        );
        for (sum, pixel) in self.sum.rgba.iter_mut().zip(&frame.rgba) {
            for channel in 0..4 {
                sum[channel] += pixel[channel];
            }
        }
        for (sum, samples) in self.sum.samples.iter_mut().zip(&frame.samples) {
            *sum = sum.saturating_add(*samples);
        }
        self.frames += 1;
    }

    /// Number of frames so far.
    pub fn frames(&self) -> u32 {
        self.frames
    }

    /// The mean of the frames so far.
    pub fn mean(mut self) -> Frame {
        if self.frames > 1 {
            let weight = 1.0 / self.frames as f32;
            for pixel in &mut self.sum.rgba {
                *pixel = pixel.map(|channel| channel * weight);
            }
        }
        self.sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_the_mean() {
        let mut a = Frame::empty(2, 1);
        a.rgba[0] = [1.0, 0.0, 0.5, 1.0];
        a.samples[0] = 3;
        let mut b = a.clone();
        b.rgba[0] = [0.0, 0.5, 0.5, 0.0];
        let mut both = Accumulator::new(a);
        both.add(&b);
        assert_eq!(both.frames(), 2);
        let mean = both.mean();
        assert_eq!(mean.rgba[0], [0.5, 0.25, 0.5, 0.5]);
        assert_eq!(mean.samples[0], 6);
    }
}
