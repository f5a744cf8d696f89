//! Plans in print.

use std::fmt;

use super::{Candidate, Method, Plan};

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rays(rays) => write!(f, "{} rays per pixel", rays.all_rays()),
            Self::Splats(splats) => {
                write!(f, "surfels of {} pixels", splats.surfelizer.radius_pixels)
            }
            Self::Obscurance { descriptor, .. } => {
                write!(
                    f,
                    "obscurance, {} reads per pixel",
                    descriptor.sampling.samples()
                )
            }
        }
    }
}

/// A table of what was weighed.
impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for candidate in &self.weighed {
            let mark = if *candidate == self.chosen { '>' } else { ' ' };
            let time = candidate
                .milliseconds
                .map_or_else(|| "-".into(), |time| format!("{time:.2} ms"));
            let megabytes = candidate.memory_bytes as f64 / 1e6;
            let refused = candidate.refused.as_deref().unwrap_or_default();
            let Candidate { method, error, .. } = candidate;
            let method = method.to_string();
            writeln!(
                f,
                "{mark} {method:32} {error:8.4} {time:>12} {megabytes:9.1} MB {refused}"
            )?;
        }
        match self.misses_by {
            Some(factor) => writeln!(
                f,
                "nothing meets the budget: it is missed by a factor of {factor:.2}"
            ),
            None => Ok(()),
        }
    }
}
