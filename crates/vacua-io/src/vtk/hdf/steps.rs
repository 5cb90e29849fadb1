//! The group `Steps`: times, and where the data of each begins.

use crate::error::Problem;
use crate::hdf5::Container;
use crate::mesh::index_at;
use crate::mesh::widened;

/// Time steps of one data set.
pub(super) struct Steps<'a> {
    file: &'a Container,
    group: String,
    /// Their times; none if nothing changes.
    pub times: Vec<f64>,
}

/// What is said to those who ask for a step that is not there.
pub(super) fn no_such_step(wanted: usize, count: usize) -> Problem {
    Problem::malformed(
        "the time steps",
        format!("step {wanted}"),
        format!("{count} steps"),
    )
}

impl<'a> Steps<'a> {
    /// Reads the times of the data set in a group.
    ///
    /// # Errors
    /// [`Problem`] if there are not as many as announced.
    pub fn read(file: &'a Container, data_set: &str) -> Result<Self, Problem> {
        let group = format!("{data_set}/Steps");
        let mut times = Vec::new();
        if file.has_group(&group)? {
            let values = file.need(&format!("{group}/Values"))?;
            let announced = file.numbers(&group, "NSteps")?;
            let announced = announced.and_then(|n| n.first().copied());
            if announced.is_some_and(|n| n != values.rows() as f64) || values.row_len() != 1 {
                return Err(Problem::malformed(
                    values.what(),
                    format!("{} times", announced.unwrap_or_default()),
                    format!("{} × {}", values.rows(), values.row_len()),
                ));
            }
            let values = values.read_all()?;
            times.extend((0..values.tuples()).map(|i| values.get_f64(i, 0)));
        }
        Ok(Self { file, group, times })
    }

    /// Fails if there is no such step; step 0 of what never changes is there.
    ///
    /// # Errors
    /// [`Problem::Malformed`].
    pub fn check(&self, step: usize) -> Result<(), Problem> {
        if step > 0 && step >= self.times.len() {
            return Err(no_such_step(step, self.times.len()));
        }
        Ok(())
    }

    /// What an array of the group says of a step; `None` if there are no steps or no such array.
    ///
    /// # Errors
    /// [`Problem`] if it has no whole number for the step.
    pub fn of(&self, name: &str, step: usize) -> Result<Option<usize>, Problem> {
        if self.times.is_empty() {
            return Ok(None);
        }
        let path = format!("{}/{name}", self.group);
        let Some(array) = self.file.array(&path)? else {
            return Ok(None);
        };
        let value = widened(array.read_rows(step, 1)?, array.what())?;
        let number = index_at(&value, 0).ok_or_else(|| {
            Problem::malformed(
                array.what(),
                format!("a number that is not negative for step {step}"),
                "another",
            )
        })?;
        Ok(Some(number))
    }
}
