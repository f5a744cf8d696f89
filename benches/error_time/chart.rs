//! Error over time, log-log: one panel per radius, one curve per method or a knob, the presets marked.

use std::{ops::Range, path::Path};

use image::{Rgb, RgbImage};
use plotters::{
    coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged},
    prelude::*,
    style::text_anchor::{HPos, Pos, VPos},
};

use super::canvas::Canvas;

/// Of a panel.
const SIZE: (u32, u32) = (750, 720);

/// A colour a curve, told apart in grey too (after Okabe and Ito, 2008).
const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(150, 120, 0),
    RGBColor(110, 110, 110),
];

/// A setting's place.
pub struct Point {
    /// The setting's value.
    pub label: String,
    /// Time, relative to the balanced preset's.
    pub time: f64,
    /// RMSE.
    pub error: f64,
}

/// What one panel shows.
pub struct Panel {
    pub title: String,
    pub curves: Vec<(String, Vec<Point>)>,
    pub presets: Vec<Point>,
    /// RMSE of exact rays against the surface that the depth buffer holds, nothing behind it.
    pub depth_alone: Option<f64>,
}

/// Draws the panels side by side and writes a PNG.
pub fn write(path: &Path, panels: &[Panel]) -> Result<(), String> {
    let mut picture = RgbImage::from_pixel(SIZE.0 * panels.len() as u32, SIZE.1, Rgb([255; 3]));
    draw(&mut picture, panels).map_err(|e| format!("{}: {e}", path.display()))?;
    picture
        .save(path)
        .map_err(|e| format!("{}: {e}", path.display()))
}

fn draw(picture: &mut RgbImage, panels: &[Panel]) -> Result<(), Box<dyn std::error::Error>> {
    let points = || {
        panels.iter().flat_map(|p| {
            p.curves
                .iter()
                .flat_map(|(_, curve)| curve)
                .chain(&p.presets)
        })
    };
    let times = bounds(points().map(|p| p.time), 1.25);
    let alone = panels.iter().filter_map(|p| p.depth_alone);
    let errors = bounds(points().map(|p| p.error).chain(alone), 1.1);
    let area = Canvas(picture).into_drawing_area();
    for (area, panel) in area.split_evenly((1, panels.len())).iter().zip(panels) {
        let text = ("mono", 16).into_font().color(&BLACK);
        let mut chart = ChartBuilder::on(area)
            .margin(14)
            .caption(&panel.title, text.clone())
            .x_label_area_size(48)
            .y_label_area_size(72)
            .build_cartesian_2d(LogAxis(times.clone()), LogAxis(errors.clone()))?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(215, 215, 215))
            .label_style(text.clone())
            .x_desc("time / time of the balanced preset")
            .y_desc("RMSE against traced truth")
            .x_label_formatter(&|v| format!("{v}"))
            .y_label_formatter(&|v| format!("{v}"))
            .draw()?;
        for ((name, curve), color) in panel.curves.iter().zip(COLORS) {
            chart
                .draw_series(LineSeries::new(
                    curve.iter().map(|p| (p.time, p.error)),
                    color.stroke_width(2),
                ))?
                .label(name)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 22, y)], color.stroke_width(2))
                });
            chart.draw_series(
                curve
                    .iter()
                    .map(|p| Circle::new((p.time, p.error), 4, color.filled())),
            )?;
            // The ends say which way the setting runs; curves cross, so its first value stands above and its last below.
            let ends = [
                (curve.first(), VPos::Bottom, 1.015),
                (curve.last(), VPos::Top, 0.985),
            ];
            for (end, side, apart) in ends {
                let Some(end) = end else { continue };
                let style = text.clone().color(&color).pos(Pos::new(HPos::Center, side));
                chart.draw_series([Text::new(
                    end.label.clone(),
                    (end.time, end.error * apart),
                    style,
                )])?;
            }
        }
        if let Some(level) = panel.depth_alone {
            chart.draw_series([PathElement::new(
                [(times.start, level), (times.end, level)],
                BLACK.mix(0.5),
            )])?;
            chart.draw_series([Text::new(
                "rays traced against the depth buffer",
                (times.start * 1.05, level),
                text.clone().pos(Pos::new(HPos::Left, VPos::Bottom)),
            )])?;
        }
        for preset in &panel.presets {
            let at = (preset.time, preset.error);
            chart.draw_series([TriangleMarker::new(at, 11, BLACK.filled())])?;
            // On its left where there is no room on its right.
            let side = if preset.time * 1.3 > times.end {
                HPos::Right
            } else {
                HPos::Left
            };
            let style = text.clone().pos(Pos::new(side, VPos::Center));
            chart.draw_series([Text::new(format!("  {}  ", preset.label), at, style)])?;
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .label_font(text)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK)
            .draw()?;
    }
    area.present()?;
    Ok(())
}

/// From the smallest to the largest of positive values, and a margin.
fn bounds(values: impl Iterator<Item = f64>, margin: f64) -> Range<f64> {
    let (low, high) = values
        .filter(|v| *v > 0.0 && v.is_finite())
        .fold((f64::INFINITY, 0.0_f64), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    if low > high {
        return 0.1..10.0;
    }
    low / margin..high * margin
}

/// A logarithmic axis with several ticks in every power of ten: plotters' own has a tick a decade, and errors
/// span hardly more than one.
struct LogAxis(Range<f64>);

impl Ranged for LogAxis {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value / self.0.start).ln() / (self.0.end / self.0.start).ln();
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _hint: Hint) -> Vec<f64> {
        let first = self.0.start.log10().floor() as i32;
        let last = self.0.end.log10().ceil() as i32;
        // The longer the axis the fewer ticks, or their labels would touch.
        let steps: &[f64] = match self.0.end / self.0.start {
            1000.0.. => &[1.0, 3.0],
            50.0.. => &[1.0, 2.0, 5.0],
            _ => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0],
        };
        (first..=last)
            .flat_map(|decade| steps.iter().map(move |s| s * 10_f64.powi(decade)))
            // Powers are off in the last digits, which labels would show.
            .map(|v| (v * 1e9).round() / 1e9)
            .filter(|v| self.0.contains(v))
            .collect()
    }

    fn range(&self) -> Range<f64> {
        self.0.clone()
    }
}
