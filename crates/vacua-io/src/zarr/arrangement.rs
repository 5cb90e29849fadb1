//! Which axis of an array is which of the volume.

use super::array::Cut;
use super::ome::Axis;
use crate::error::Problem;

/// Most components a number may have; a longer last axis is more likely space or time.
const MOST_COMPONENTS: usize = 4;

/// Which axis is which; all others have one place only.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Arrangement {
    /// Those that x, y and z run along.
    pub space: [usize; 3],
    pub time: Option<usize>,
    pub channel: Option<usize>,
    pub components: Option<usize>,
}

impl Arrangement {
    /// By the axes' names and kinds.
    ///
    /// # Errors
    /// [`Problem::Unsupported`] if there are more or fewer than three in space.
    pub fn of_axes(axes: &[Axis], shape: &[usize]) -> Result<Self, Problem> {
        let find = |kind: &str, names: &[&str]| {
            let by_kind = axes
                .iter()
                .position(|axis| axis.kind.as_deref() == Some(kind));
            by_kind.or_else(|| axes.iter().position(|axis| names.contains(&&*axis.name)))
        };
        let time = find("time", &["t", "time"]);
        let channel = find("channel", &["c", "channel"]);
        let others: Vec<usize> = (0..axes.len())
            .filter(|&axis| Some(axis) != time && Some(axis) != channel)
            .collect();
        let named = ["x", "y", "z"].map(|name| {
            let is_it = |axis: &&usize| axes[**axis].name == name;
            others.iter().find(is_it).copied()
        });
        let space = match named {
            [Some(x), Some(y), Some(z)] => [x, y, z],
            _ => {
                let long = |axis: &usize| others.len() == 3 || shape[*axis] > 1;
                let long: Vec<usize> = others.iter().copied().filter(long).collect();
                match long[..] {
                    [z, y, x] => [x, y, z],
                    _ => return Err(unsuited(shape, &long)),
                }
            }
        };
        let is_left_out = |axis: &usize| !space.contains(axis) && shape[*axis] > 1;
        let left_out: Vec<&str> = others
            .iter()
            .filter(|axis| is_left_out(axis))
            .map(|&axis| &*axes[axis].name)
            .collect();
        if !left_out.is_empty() {
            return Err(Problem::unsupported(format!(
                "an axis besides space, time and channels (`{}`)",
                left_out.join("`, `")
            )));
        }
        let arrangement = Self {
            space,
            time,
            channel,
            components: None,
        };
        arrangement.checked(shape)
    }

    /// By their order: the last three are space, or those before components, of which there are few. Leading axes
    /// of one place are left out.
    ///
    /// # Errors
    /// As [`Arrangement::of_axes`].
    pub fn without_names(shape: &[usize]) -> Result<Self, Problem> {
        let n = shape.len();
        let leading = shape
            .iter()
            .take(n.saturating_sub(3))
            .take_while(|&&n| n == 1)
            .count();
        let (space, components) = match shape[leading..] {
            [_, _, _] => ([n - 1, n - 2, n - 3], None),
            [_, _, _, c] if c <= MOST_COMPONENTS => ([n - 2, n - 3, n - 4], Some(n - 1)),
            _ => return Err(unsuited(shape, &[])),
        };
        let arrangement = Self {
            space,
            time: None,
            channel: None,
            components,
        };
        arrangement.checked(shape)
    }

    /// Refuses what is flat or empty.
    fn checked(self, shape: &[usize]) -> Result<Self, Problem> {
        if shape.contains(&0) {
            return Err(Problem::unsupported(format!(
                "an array of {shape:?} numbers"
            )));
        }
        if self.space.iter().any(|&axis| shape[axis] < 2) {
            return Err(Problem::unsupported_but(
                format!("a flat picture (an array of {shape:?} numbers)"),
                "a volume has at least 2 numbers along x, y and z",
            ));
        }
        Ok(self)
    }

    /// The part of an array that is a volume.
    pub fn cut(&self, step: usize, channel: usize, num_axes: usize) -> Cut {
        let mut at = vec![0; num_axes];
        if let Some(axis) = self.time {
            at[axis] = step;
        }
        if let Some(axis) = self.channel {
            at[axis] = channel;
        }
        Cut {
            space: self.space,
            components: self.components,
            at,
        }
    }
}

fn unsuited(shape: &[usize], long: &[usize]) -> Problem {
    if shape.len() < 3 || long.len() == 2 {
        return Problem::unsupported_but(
            format!("a flat picture (an array of {shape:?} numbers)"),
            "a volume has three axes",
        );
    }
    Problem::unsupported_but(
        format!("an array of {shape:?} numbers"),
        format!(
            "name its axes (dimension_names), or save it as (z, y, x), or (z, y, x, c) with c ≤ {MOST_COMPONENTS}"
        ),
    )
}
