//! Steps in place of hands, for tests: words, parted by semicolons.
//!
//! `scene NAME`, `effect a|b EFFECT METHOD`, `join a|b on|off`, `lamps a|b on|off`, `compare on|off`, `split SHARE`,
//! `scale SHARE`, `show picture|error|truth`, `mover away|moves|rests`, `key LETTER FRAMES`, `drag X Y`, `resize WxH`,
//! `frames N`, `loaded`, `traced RAYS`, `still`, `plan error|ms VALUE`, `planned`, `scroll POINTS`, `shot FILE`, `report`. The
//! window closes after the last.

use std::{collections::VecDeque, path::PathBuf};

use support::arguments;

use crate::{
    display::Shown,
    flight::Way,
    look::{Effect, Method},
    panel::Motion,
    planning::Wish,
};

/// One step.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    Scene(String),
    /// Of the first or the second side.
    Effect(usize, Effect, Method),
    /// Whether a side's frames are joined.
    Join(usize, bool),
    /// Whether a side's rays are aimed at what shines.
    Lamps(usize, bool),
    Compare(bool),
    Split(f32),
    Scale(f32),
    Show(Shown),
    Mover(Motion),
    Key(Way, u32),
    Drag([f64; 2]),
    Resize([u32; 2]),
    Frames(u32),
    Loaded,
    /// Until so many rays are known.
    Traced(u32),
    Still,
    Plan(Wish),
    Planned,
    /// The panel, by so many points.
    Scroll(f32),
    Shot(PathBuf),
    Report,
}

/// Those that are left.
#[derive(Debug, Default)]
pub struct Script {
    pub steps: VecDeque<Step>,
}

impl Script {
    /// # Errors
    /// The step that is none.
    pub fn parse(text: &str) -> Result<Self, String> {
        let texts = text.split(';').map(str::trim).filter(|s| !s.is_empty());
        let steps = texts.map(|text| step(text).ok_or_else(|| format!("no step: {text}")));
        Ok(Self {
            steps: steps.collect::<Result<_, _>>()?,
        })
    }
}

/// Of a side.
fn number(side: &str) -> Option<usize> {
    ["a", "b"].iter().position(|s| *s == side)
}

fn step(text: &str) -> Option<Step> {
    let words: Vec<&str> = text.split_whitespace().collect();
    Some(match words[..] {
        ["scene", name] => Step::Scene(name.into()),
        ["effect", side, effect, method] => Step::Effect(
            number(side)?,
            Effect::ALL.into_iter().find(|e| e.short() == effect)?,
            [Method::Rays, Method::Splats, Method::Depths, Method::Hull]
                .into_iter()
                .find(|m| m.short() == method)?,
        ),
        ["join", side, on] => Step::Join(number(side)?, on == "on"),
        ["lamps", side, on] => Step::Lamps(number(side)?, on == "on"),
        ["compare", on] => Step::Compare(on == "on"),
        ["split", share] => Step::Split(share.parse().ok()?),
        ["scale", share] => Step::Scale(share.parse().ok()?),
        ["show", "picture"] => Step::Show(Shown::Picture),
        ["show", "error"] => Step::Show(Shown::Error),
        ["show", "truth"] => Step::Show(Shown::Truth),
        ["mover", "away"] => Step::Mover(Motion::Away),
        ["mover", "moves"] => Step::Mover(Motion::Moving),
        ["mover", "rests"] => Step::Mover(Motion::Resting),
        ["key", letter, frames] => Step::Key(
            Way::ALL.into_iter().find(|way| way.key() == letter)?,
            frames.parse().ok()?,
        ),
        ["drag", x, y] => Step::Drag([x.parse().ok()?, y.parse().ok()?]),
        ["resize", size] => Step::Resize(arguments::parse_size(size).ok()?),
        ["frames", n] => Step::Frames(n.parse().ok()?),
        ["loaded"] => Step::Loaded,
        ["traced", rays] => Step::Traced(rays.parse().ok()?),
        ["still"] => Step::Still,
        ["plan", "error", value] => Step::Plan(Wish::Error(value.parse().ok()?)),
        ["plan", "ms", value] => Step::Plan(Wish::Milliseconds(value.parse().ok()?)),
        ["planned"] => Step::Planned,
        ["scroll", points] => Step::Scroll(points.parse().ok()?),
        ["shot", file] => Step::Shot(file.into()),
        ["report"] => Step::Report,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_step_is_named() {
        let script = Script::parse("frames 3; effect b gi splats;resize 1x1; ").unwrap();
        let steps = [
            Step::Frames(3),
            Step::Effect(1, Effect::IndirectDiffuse, Method::Splats),
            Step::Resize([1, 1]),
        ];
        assert_eq!(script.steps, steps);
        let wrong = Script::parse("frames 3; fly").unwrap_err();
        assert_eq!(wrong, "no step: fly");
    }
}
