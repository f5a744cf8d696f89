//! A picture that plotters draws into, with text that needs no font of the system.

use std::convert::Infallible;

use image::{Rgb, RgbImage};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use plotters_backend::{
    BackendColor, BackendCoord, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    text_anchor::{HPos, VPos},
};

/// Height of every letter's box, pixels; styles' sizes are not looked at.
const LINE: RasterHeight = RasterHeight::Size16;

/// Draws into an image that it borrows.
pub struct Canvas<'i>(pub &'i mut RgbImage);

type Drawn = Result<(), DrawingErrorKind<Infallible>>;

impl Canvas<'_> {
    fn blend(&mut self, (x, y): BackendCoord, (r, g, b): (u8, u8, u8), alpha: f64) {
        let inside = u32::try_from(x).ok().zip(u32::try_from(y).ok());
        if let Some(pixel) = inside.and_then(|(x, y)| self.0.get_pixel_mut_checked(x, y)) {
            let mix = |old: u8, new: u8| {
                (f64::from(old) * (1.0 - alpha) + f64::from(new) * alpha).round() as u8
            };
            let Rgb([old_r, old_g, old_b]) = *pixel;
            *pixel = Rgb([mix(old_r, r), mix(old_g, g), mix(old_b, b)]);
        }
    }
}

impl DrawingBackend for Canvas<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.0.dimensions()
    }

    fn ensure_prepared(&mut self) -> Drawn {
        Ok(())
    }

    fn present(&mut self) -> Drawn {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Drawn {
        self.blend(point, color.rgb, color.alpha);
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        _style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let width = get_raster_width(FontWeight::Regular, LINE) * text.chars().count();
        Ok((width as u32, LINE.val() as u32))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        position: BackendCoord,
    ) -> Drawn {
        let (width, height) = self.estimate_text_size(text, style)?;
        let (width, height) = (width as i32, height as i32);
        let turned = style.transform();
        // Anchors are those of the text as it is read, before it is turned.
        let left = match style.anchor().h_pos {
            HPos::Left => 0,
            HPos::Center => -width / 2,
            HPos::Right => -width,
        };
        let top = match style.anchor().v_pos {
            VPos::Top => 0,
            VPos::Center => -height / 2,
            VPos::Bottom => -height,
        };
        let BackendColor { rgb, alpha } = style.color();
        let glyph_width = get_raster_width(FontWeight::Regular, LINE);
        for (place, letter) in text.chars().enumerate() {
            let glyph = get_raster(letter, FontWeight::Regular, LINE)
                .or_else(|| get_raster('?', FontWeight::Regular, LINE))
                .expect("the font has a question mark");
            for (y, row) in glyph.rows().enumerate() {
                for (x, &coverage) in row.iter().enumerate() {
                    let x = left + (place * glyph_width + x) as i32;
                    let (x, y) = turned.transform(x, top + y as i32);
                    let coverage = alpha * f64::from(coverage) / 255.0;
                    self.blend((position.0 + x, position.1 + y), rgb, coverage);
                }
            }
        }
        Ok(())
    }
}
