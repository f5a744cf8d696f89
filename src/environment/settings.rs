//! Public settings and their validation.

use crate::error::{Error, check_setting};

/// Settings of an [`Environment`](crate::Environment).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EnvironmentSettings {
    /// Columns and rows of the grid of cells that the environment is resampled to, 16…2048 and 8…1024. What is smaller than a
    /// cell becomes as large as one, with as much light: the edges of shadows are as soft as cells are wide. Memory and the
    /// time to build grow with the number of cells, the time to trace hardly. Default 256 × 128, cells of 1.4°; the sun is 0.5°
    /// wide.
    pub size: [u32; 2],
    /// Whether it is kept in coarser grids too, each half as fine as the one before, down to two rows: for effects by splatting
    /// ([`Effect::environment`](crate::Effect::environment)). A fifth more memory. Default false.
    pub levels: bool,
}

impl Default for EnvironmentSettings {
    fn default() -> Self {
        Self {
            size: [256, 128],
            levels: false,
        }
    }
}

impl EnvironmentSettings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Setting`], naming the field, its value and its range.
    pub fn validate(&self) -> Result<(), Error> {
        let [columns, rows] = self.size;
        check_setting(
            (16..=2048).contains(&columns),
            "EnvironmentSettings::size[0]",
            columns,
            "16 to 2048 columns",
        )?;
        check_setting(
            (8..=1024).contains(&rows) && rows <= columns,
            "EnvironmentSettings::size[1]",
            rows,
            "8 to 1024 rows, as many as columns at most",
        )
    }
}
