//! Mirror of `wgsl/environment.wgsl` and `wgsl/common/environment.wgsl`.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2, DVec3};

/// A picture of latitude and longitude, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Radiance.
    pub texels: Vec<DVec3>,
}

/// What rays look up and draw of an environment.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// The radiance of the cells.
    pub radiance: Picture,
    /// Of each cell the share of its row up to it, row by row.
    pub in_rows: Vec<f64>,
    /// Of each row the share of all up to it.
    pub over_rows: Vec<f64>,
    /// From its own axes to the world's.
    pub rotation: DQuat,
}

/// A direction that is drawn by the environment, and what comes from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// A unit vector of the world.
    pub direction: DVec3,
    /// Radiance.
    pub radiance: DVec3,
    /// Density over solid angle with which it is drawn, 1/sr.
    pub pdf: f64,
}

/// The brightest that counts.
const MOST_RADIANCE: f64 = 1e18;

/// What is not a number or negative counts as 0.
pub fn clean(color: DVec3) -> DVec3 {
    DVec3::from_array(color.to_array().map(|c| {
        if c.is_nan() {
            0.0
        } else {
            c.clamp(0.0, MOST_RADIANCE)
        }
    }))
}

/// The solid angle between two polar angles, over 4 π.
fn belt(begin: f64, end: f64) -> f64 {
    (0.5 * (begin + end)).sin() * (0.5 * (end - begin).max(0.0)).sin()
}

/// Unit vector to where a share of the width and of the height of a picture leads.
pub fn direction_at(u: f64, v: f64) -> DVec3 {
    let (angle, polar) = (2.0 * PI * (u - 0.5), PI * v);
    DVec3::new(
        angle.cos() * polar.sin(),
        polar.cos(),
        angle.sin() * polar.sin(),
    )
}

impl Picture {
    /// Of a function of a unit vector, taken in the middle of each texel.
    pub fn of([columns, rows]: [usize; 2], radiance: impl Fn(DVec3) -> DVec3) -> Self {
        let texels = (0..columns * rows).map(|i| {
            let middle = |index: usize, count: usize| (index as f64 + 0.5) / count as f64;
            radiance(direction_at(
                middle(i % columns, columns),
                middle(i / columns, rows),
            ))
        });
        Self {
            size: [columns, rows],
            texels: texels.collect(),
        }
    }

    /// The texel in a direction, a unit vector of its own axes.
    pub fn at(&self, d: DVec3) -> DVec3 {
        let [x, y] = self.place(d);
        self.texels[y * self.size[0] + x]
    }

    fn place(&self, d: DVec3) -> [usize; 2] {
        let u = d.z.atan2(d.x) / (2.0 * PI) + 0.5;
        let v = d.x.hypot(d.z).atan2(d.y) / PI;
        let texel = |share: f64, count: usize| ((share * count as f64) as usize).min(count - 1);
        [texel(u, self.size[0]), texel(v, self.size[1])]
    }

    /// The same light on a grid of cells: of each the mean over the texels, by how much of them lies in it.
    #[must_use]
    pub fn resampled(&self, [columns, rows]: [usize; 2]) -> Self {
        let [width, height] = self.size;
        let per_row = PI / height as f64;
        let scale = [width as f64 / columns as f64, height as f64 / rows as f64];
        let texels = (0..columns * rows).map(|i| {
            let low = [i % columns, i / columns];
            let [x0, y0] = [0, 1].map(|axis: usize| low[axis] as f64 * scale[axis]);
            let [x1, y1] = [0, 1].map(|axis: usize| (low[axis] + 1) as f64 * scale[axis]);
            let (mut sum, mut weights) = (DVec3::ZERO, 0.0);
            for y in y0 as usize..(y1.ceil() as usize).min(height) {
                let [from, to] = [y0.max(y as f64), y1.min((y + 1) as f64)];
                let tall = belt(from * per_row, to * per_row);
                for x in x0 as usize..(x1.ceil() as usize).min(width) {
                    let wide = (x1.min((x + 1) as f64) - x0.max(x as f64)).max(0.0);
                    sum += tall * wide * clean(self.texels[y * width + x]);
                    weights += tall * wide;
                }
            }
            sum / f64::max(weights, 1e-30)
        });
        Self {
            size: [columns, rows],
            texels: texels.collect(),
        }
    }

    /// The solid angle of a texel.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let per_row = PI / self.size[1] as f64;
        let height = belt(row as f64 * per_row, (row + 1) as f64 * per_row);
        4.0 * PI / self.size[0] as f64 * height
    }

    /// What the surface with a unit normal of its own axes receives with nothing in the way, W/m², texel by texel.
    pub fn irradiance(&self, normal: DVec3) -> DVec3 {
        let [columns, rows] = self.size;
        (0..columns * rows)
            .map(|i| {
                let (x, y) = (i % columns, i / columns);
                let d = direction_at(
                    (x as f64 + 0.5) / columns as f64,
                    (y as f64 + 0.5) / rows as f64,
                );
                self.texels[i] * (normal.dot(d).max(0.0) * self.solid_angle(y))
            })
            .sum()
    }
}

/// The real spherical harmonics of orders 0 to 2.
pub fn harmonics_at(d: DVec3) -> [f64; 9] {
    let constants = [
        0.282_094_792,
        0.488_602_512,
        0.488_602_512,
        0.488_602_512,
        1.092_548_431,
        1.092_548_431,
        0.315_391_565,
        1.092_548_431,
        0.546_274_215,
    ];
    let polynomials = polynomials_at(d);
    std::array::from_fn(|i| constants[i] * polynomials[i])
}

/// The polynomials that they are multiples of.
pub fn polynomials_at(d: DVec3) -> [f64; 9] {
    [
        1.0,
        d.y,
        d.z,
        d.x,
        d.x * d.y,
        d.y * d.z,
        3.0 * d.z * d.z - 1.0,
        d.x * d.z,
        d.x * d.x - d.y * d.y,
    ]
}

impl Cells {
    /// The tables of an environment, whose radiance has been cleaned.
    pub fn new(radiance: Picture, rotation: DQuat) -> Self {
        let [columns, rows] = radiance.size;
        let power = |i: usize| radiance.texels[i].element_sum() / 3.0;
        let per_row = PI / rows as f64;
        let heights: Vec<f64> = (0..rows)
            .map(|y| belt(y as f64 * per_row, (y + 1) as f64 * per_row))
            .collect();
        let mut in_rows = Vec::new();
        let mut row_powers = Vec::new();
        for y in 0..rows {
            let row = y * columns..(y + 1) * columns;
            let total: f64 = row.clone().map(power).sum();
            row_powers.push(total / columns as f64);
            let mut sum = 0.0;
            for (x, i) in row.enumerate() {
                sum += power(i);
                let even = (x + 1) as f64 / columns as f64;
                in_rows.push(if total > 1e-30 { sum / total } else { even });
            }
        }
        let total: f64 = heights.iter().zip(&row_powers).map(|(h, p)| h * p).sum();
        let whole: f64 = heights.iter().sum();
        let (mut sum, mut height_sum) = (0.0, 0.0);
        let over_rows = heights.iter().zip(&row_powers).map(|(height, power)| {
            sum += height * power;
            height_sum += height;
            if total > 1e-30 {
                sum / total
            } else {
                height_sum / whole
            }
        });
        Self {
            over_rows: over_rows.collect(),
            radiance,
            in_rows,
            rotation,
        }
    }

    fn to_world(&self) -> DMat3 {
        DMat3::from_quat(self.rotation.normalize())
    }

    fn row_range(&self, row: usize) -> [f64; 2] {
        [
            if row == 0 {
                0.0
            } else {
                self.over_rows[row - 1]
            },
            self.over_rows[row],
        ]
    }

    fn cell_range(&self, [x, y]: [usize; 2]) -> [f64; 2] {
        let i = y * self.radiance.size[0] + x;
        [
            if x == 0 { 0.0 } else { self.in_rows[i - 1] },
            self.in_rows[i],
        ]
    }

    fn drawn(&self, direction: DVec3, cell: [usize; 2]) -> Sample {
        let (row, column) = (self.row_range(cell[1]), self.cell_range(cell));
        Sample {
            direction,
            radiance: self.radiance.texels[cell[1] * self.radiance.size[0] + cell[0]],
            pdf: (row[1] - row[0]) * (column[1] - column[0]) / self.radiance.solid_angle(cell[1]),
        }
    }

    /// What comes from a direction of the world, a unit vector, and the density with which it is drawn.
    pub fn at(&self, direction: DVec3) -> Sample {
        let d = self.to_world().transpose() * direction;
        self.drawn(direction, self.radiance.place(d))
    }

    /// A point of the unit square, each coordinate below 1, to a direction.
    pub fn sample(&self, point: DVec2) -> Sample {
        let [columns, rows] = self.radiance.size;
        let y = self.over_rows.partition_point(|end| *end <= point.y);
        let y = y.min(rows - 1);
        let of_row = &self.in_rows[y * columns..(y + 1) * columns];
        let x = of_row.partition_point(|end| *end <= point.x);
        let x = x.min(columns - 1);
        let (row, column) = (self.row_range(y), self.cell_range([x, y]));
        let within = |value: f64, [begin, end]: [f64; 2]| {
            ((value - begin) / (end - begin).max(1e-30)).clamp(0.0, 1.0)
        };
        let per_row = PI / rows as f64;
        let [top, bottom] = [y, y + 1].map(|y| (per_row * y as f64).cos());
        let height = top + (bottom - top) * within(point.y, row);
        let angle = 2.0 * PI * ((x as f64 + within(point.x, column)) / columns as f64 - 0.5);
        let flat = ((1.0 - height) * (1.0 + height)).max(0.0).sqrt();
        let d = DVec3::new(angle.cos() * flat, height, angle.sin() * flat);
        self.drawn(self.to_world() * d, [x, y])
    }

    /// As [`Environment::irradiance`](crate::Environment::irradiance).
    pub fn irradiance(&self) -> [DVec3; 9] {
        let [columns, rows] = self.radiance.size;
        let mut sums = [DVec3::ZERO; 9];
        for y in 0..rows {
            for x in 0..columns {
                let d = direction_at(
                    (x as f64 + 0.5) / columns as f64,
                    (y as f64 + 0.5) / rows as f64,
                );
                let color = self.radiance.texels[y * columns + x] * self.radiance.solid_angle(y);
                for (sum, basis) in sums.iter_mut().zip(harmonics_at(d)) {
                    *sum += basis * color;
                }
            }
        }
        // The constants of the basis, which the polynomials lack.
        let constants = harmonics_at(DVec3::new(1.0, 1.0, 1.0));
        let polynomials = polynomials_at(DVec3::new(1.0, 1.0, 1.0));
        std::array::from_fn(|i| {
            let order = match i {
                0 => PI,
                1..=3 => 2.0 * PI / 3.0,
                _ => PI / 4.0,
            };
            let constant = match i {
                8 => 0.546_274_215,
                _ => constants[i] / polynomials[i],
            };
            sums[i] * (order * constant)
        })
    }
}

/// An environment as sums of large terms read it: `wgsl/common/environment_levels.wgsl`.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels {
    /// Each half as fine as the one before, down to two rows.
    pub grids: Vec<Picture>,
    /// As [`Cells::irradiance`].
    pub irradiance: [DVec3; 9],
    /// From its own axes to the world's.
    pub rotation: DQuat,
}

impl Levels {
    /// Those of an environment.
    pub fn new(cells: &Cells) -> Self {
        let [columns, rows] = cells.radiance.size;
        let mut grids = vec![cells.radiance.clone()];
        for level in 1..rows.ilog2() {
            let coarser = grids[level as usize - 1].resampled([columns >> level, rows >> level]);
            grids.push(coarser);
        }
        Self {
            grids,
            irradiance: cells.irradiance(),
            rotation: cells.rotation,
        }
    }

    fn to_world(&self) -> DMat3 {
        DMat3::from_quat(self.rotation.normalize())
    }

    /// The mean radiance of about a solid angle about a direction of the world, a unit vector.
    pub fn mean(&self, direction: DVec3, solid_angle: f64) -> DVec3 {
        let finest = self.grids[0].size[1] as f64 / PI;
        let level = (solid_angle.sqrt() * finest).max(1.0).log2() + 0.5;
        let level = level.clamp(0.0, self.grids.len() as f64 - 0.5) as usize;
        self.grids[level].at(self.to_world().transpose() * direction)
    }

    /// What a surface with a unit normal of the world's has of it without anything in its way, W/m², 0 or more.
    pub fn irradiance_at(&self, normal: DVec3) -> DVec3 {
        let polynomials = polynomials_at(self.to_world().transpose() * normal);
        let terms = self.irradiance.iter().zip(polynomials);
        let sum: DVec3 = terms.map(|(coefficient, p)| *coefficient * p).sum();
        sum.max(DVec3::ZERO)
    }
}
