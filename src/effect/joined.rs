//! Two effects in one: both sources with all that they declare renamed, and functions of theirs that call both.

use std::{borrow::Cow, collections::BTreeSet, fmt::Write as _};

use super::{Effect, receiver_argument};
use crate::{
    error::{Error, check_setting},
    gpu::tokens::{tokens, without_comments},
};

impl Effect {
    /// This effect and another in one splat: their surfels are culled, loaded and looped over once. Outputs are this one's,
    /// then the other's, each as it is of the effect alone but for what levels leave of noise: a surfel is on the level that the
    /// effect asks for that reaches farther.
    ///
    /// The other's names do not collide with this one's, so that an effect may be joined with itself under other settings, and
    /// joined ones with more. Where one of the two leaves out surfels below a pixel's own surface
    /// ([`own_surface`](Effect::own_surface)), the other does. A sum that is not finite in a channel of one counts for nothing in
    /// both.
    ///
    /// # Errors
    /// [`Error::Setting`] where both have more than 8 channels together, or one of them none; [`Error::Effect`] for outputs or
    /// constants that a source does not have.
    pub fn and(&self, other: &Self) -> Result<Self, Error> {
        self.check()?;
        other.check()?;
        let channels = self.channels + other.channels;
        check_setting(
            channels <= Self::MAX_CHANNELS,
            "Effect::channels",
            channels,
            "1 to 8, of joined effects together",
        )?;
        let [first, second, own] = free_prefixes([self, other]);
        let parts = [
            Part::new(self, first, 0, channels),
            Part::new(other, second, self.channels, channels),
        ];
        let mut source = String::new();
        for part in &parts {
            source += &part.source;
        }
        let both = parts.each_ref();
        let own_surface = self.own_surface || other.own_surface;
        let receiver = self.receiver() || other.receiver();
        source += &joining(both, channels, [own_surface, receiver]);
        let mut outputs = Vec::new();
        for part in both {
            for name in &part.effect.outputs {
                let output = format!("{own}output{}", outputs.len());
                source += &part.output(name, &output, receiver);
                outputs.push(output.into());
            }
        }
        Ok(Self {
            label: Cow::Owned(format!("{} and {}", self.label, other.label)),
            source: source.into(),
            channels,
            outputs,
            materials: self.materials || other.materials,
            radiance: self.radiance || other.radiance,
            albedo: self.albedo || other.albedo,
            normal: self.normal || other.normal,
            view: self.view || other.view,
            roughness: self.roughness || other.roughness,
            environment: self.environment || other.environment,
            two_sided: self.two_sided || other.two_sided,
            own_surface,
            constants: both.map(Part::constants).concat(),
        })
    }
}

/// One of two joined effects.
struct Part<'a> {
    effect: &'a Effect,
    prefix: String,
    /// Its own, renamed, and the type of its sums.
    source: String,
    /// What is its own of a sum of both.
    share: String,
}

impl<'a> Part<'a> {
    fn new(effect: &'a Effect, prefix: String, first: u32, all: u32) -> Self {
        let ty = type_of(effect.channels);
        let source = format!(
            "alias {prefix}Sum = {ty};\n{}\n",
            renamed(&effect.source, &prefix)
        );
        let own = (first..first + effect.channels).map(|i| component("sum", all, i));
        Self {
            share: sum_of(ty, own.collect()),
            effect,
            prefix,
            source,
        }
    }

    /// The function that makes this picture of a sum of both.
    fn output(&self, name: &str, output: &str, receiver: bool) -> String {
        let Self { prefix, share, .. } = self;
        let albedo = if self.effect.albedo {
            "albedo"
        } else {
            "vec3f(1.0)"
        };
        let [declared, _] = receiver_argument(receiver);
        let [_, passed] = receiver_argument(self.effect.receiver());
        format!(
            "fn {output}(sum: Sum, albedo: vec3f{declared}) -> vec4f {{\n  return {prefix}{name}({share}, {albedo}{passed});\n}}\n"
        )
    }

    /// Under their new names.
    fn constants(&self) -> Vec<(String, f64)> {
        let source = without_comments(&self.effect.source);
        let tokens = tokens(&source);
        let named = |key: &str| {
            let numbered = ["@", "id", "(", key, ")", "override"];
            let mut windows = tokens.windows(7);
            let found = windows.find(|words| words[..6] == numbered);
            found.map_or_else(|| key.to_owned(), |words| words[6].to_owned())
        };
        let constants = self.effect.constants.iter();
        constants
            .map(|(key, value)| (format!("{}{}", self.prefix, named(key)), *value))
            .collect()
    }
}

/// What the splatter calls.
fn joining(parts: [&Part<'_>; 2], channels: u32, [own_surface, receiver]: [bool; 2]) -> String {
    let [a, b] = parts.map(|part| part.prefix.as_str());
    let [wide_a, wide_b] = parts.map(|part| part.effect.channels);
    let components = (0..wide_a).map(|i| component("first", wide_a, i));
    let components = components.chain((0..wide_b).map(|i| component("second", wide_b, i)));
    let sum = sum_of("Sum", components.collect());
    let [declared, _] = receiver_argument(receiver);
    let [to_a, to_b] = parts.map(|part| receiver_argument(part.effect.receiver())[1]);
    debug_assert_eq!(channels, wide_a + wide_b);
    let mut text = format!(
        "fn max_distance(sender: Sender, epsilon: f32) -> f32 {{
  return max({a}max_distance(sender, epsilon), {b}max_distance(sender, epsilon));
}}
fn contribution(sender: Sender, receiver_normal: vec3f, to_sender: vec3f, distance2: f32{declared}) -> Sum {{
  let first = {a}contribution(sender, receiver_normal, to_sender, distance2{to_a});
  let second = {b}contribution(sender, receiver_normal, to_sender, distance2{to_b});
  return {sum};
}}
"
    );
    if own_surface {
        let [first, second] = parts.map(|part| {
            let call = if part.effect.own_surface {
                "own_surface(cosine)"
            } else {
                "Sum()"
            };
            format!("{}{call}", part.prefix)
        });
        let _ = write!(
            text,
            "fn own_surface(cosine: f32) -> Sum {{
  let first = {first};
  let second = {second};
  return {sum};
}}
"
        );
    }
    text
}

/// The type of sums of so many channels, as `wgsl/common/sums.wgsl` has it.
fn type_of(channels: u32) -> &'static str {
    match channels {
        0 | 1 => "f32",
        2 => "vec2f",
        3 => "vec3f",
        4 => "vec4f",
        _ => "mat2x4f",
    }
}

/// A channel of a sum of so many.
fn component(sum: &str, channels: u32, i: u32) -> String {
    let letter = ["x", "y", "z", "w"][(i % 4) as usize];
    match channels {
        1 => sum.to_owned(),
        2..=4 => format!("{sum}.{letter}"),
        _ => format!("{sum}[{}].{letter}", i / 4),
    }
}

/// One of its channels.
fn sum_of(ty: &str, mut components: Vec<String>) -> String {
    if components.len() > 4 {
        components.resize(8, "0.0".into());
    }
    format!("{ty}({})", components.join(", "))
}

/// Three beginnings of names that no word of the sources has.
fn free_prefixes(effects: [&Effect; 2]) -> [String; 3] {
    let prefix = |n: usize| format!("effect{n}_");
    let taken = |n: &usize| effects.iter().any(|e| e.source.contains(&prefix(*n)));
    let mut free = (0..).filter(|n| !taken(n)).map(prefix);
    [(); 3].map(|()| free.next().unwrap_or_default())
}

/// Names that a source declares at module scope.
fn declared<'a>(tokens: &[&'a str]) -> BTreeSet<&'a str> {
    const KEYWORDS: [&str; 6] = ["fn", "var", "const", "override", "struct", "alias"];
    let mut names = BTreeSet::new();
    let mut depth = 0_i32;
    for (i, token) in tokens.iter().enumerate() {
        match *token {
            "{" => depth += 1,
            "}" => depth -= 1,
            keyword if depth == 0 && KEYWORDS.contains(&keyword) => {
                let mut after = tokens[i + 1..].iter();
                if after.clone().next() == Some(&"<") {
                    after.find(|token| **token == ">");
                }
                names.extend(after.next());
            }
            _ => {}
        }
    }
    names
}

/// A source with `prefix` before every name that it declares, and before `Sum`, and without the numbers of its constants. Members
/// and attributes keep theirs, and so do directives.
fn renamed(source: &str, prefix: &str) -> String {
    let source = without_comments(source);
    let tokens = tokens(&source);
    let mut names = declared(&tokens);
    names.insert("Sum");
    let mut out = String::with_capacity(2 * source.len());
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    // Of a struct's braces.
    let mut is_struct = false;
    let mut before = "";
    for line in source.lines() {
        if line.trim_start().starts_with('#') {
            out += line;
            out.push('\n');
            continue;
        }
        let mut rest = line;
        while let Some(c) = rest.chars().next() {
            let end = if is_word(c) {
                rest.find(|c| !is_word(c)).unwrap_or(rest.len())
            } else {
                c.len_utf8()
            };
            let (token, after) = rest.split_at(end);
            rest = after;
            if token == "@"
                && let Some(numbered) = rest.strip_prefix("id(")
            {
                rest = numbered.split_once(')').map_or("", |(_, rest)| rest);
                continue;
            }
            let is_member = before == "." || is_struct && after.trim_start().starts_with(':');
            if names.contains(token) && !is_member && before != "@" {
                out += prefix;
            }
            out += token;
            if c.is_whitespace() {
                continue;
            }
            is_struct = (is_struct || token == "struct") && token != "}";
            before = token;
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_renamed_and_nothing_else() {
        let source = "
#import packing
struct Lobe { radius: f32, gain: Sum }
override gain: f32 = 1.0; @id(7) override numbered: f32;
var<private> state : array<Lobe, 2>; // gain
const radius = 2.0f;
fn resolve(sum: Sum, gain_of: f32) -> vec4f { /* radius */
  let lobe = Lobe(radius, sum * gain);
  return vec4f(lobe.radius * state[0].gain * numbered);
}";
        let expected = "

#import packing
struct p_Lobe { radius: f32, gain: p_Sum }
override p_gain: f32 = 1.0;  override p_numbered: f32;
var<private> p_state : array<p_Lobe, 2>;
const p_radius = 2.0f;
fn p_resolve(sum: p_Sum, gain_of: f32) -> vec4f {
  let lobe = p_Lobe(p_radius, sum * p_gain);
  return vec4f(lobe.radius * p_state[0].gain * p_numbered);
}";
        let trimmed = |text: &str| -> Vec<String> {
            let lines = text.lines().map(|line| line.trim_end().to_owned());
            lines.filter(|line| !line.is_empty()).collect()
        };
        assert_eq!(trimmed(&renamed(source, "p_")), trimmed(expected));
    }

    fn constant(label: &'static str, channels: u32) -> Effect {
        Effect {
            channels,
            constants: vec![("3".into(), 2.0)],
            ..Effect::new(
                label,
                "@id(3) override gain: f32;
                 fn max_distance(sender: Sender, epsilon: f32) -> f32 { return gain; }
                 fn contribution(s: Sender, n: vec3f, to: vec3f, d2: f32) -> Sum { return Sum(); }
                 fn resolve(sum: Sum, albedo: vec3f) -> vec4f { return vec4f(gain); }",
            )
        }
    }

    #[test]
    fn joined_effects_join_again() {
        let one = constant("one", 1);
        let pair = one.and(&one).expect("two channels");
        let all = pair.and(&constant("five", 5)).expect("seven channels");
        assert_eq!((all.channels, all.outputs.len()), (7, 3));
        let keys: BTreeSet<_> = all.constants.iter().map(|(key, _)| key).collect();
        assert_eq!(keys.len(), 3, "{keys:?}");
        assert_eq!(all.check(), Ok(()));
        let error = all.and(&pair).expect_err("nine channels");
        assert!(error.to_string().contains("is 9"), "{error}");
        let none = constant("none", 0);
        assert!(one.and(&none).is_err() && none.and(&one).is_err());
        let unknown = Effect {
            outputs: vec!["resolve_all".into()],
            ..one.clone()
        };
        let error = unknown.and(&one).expect_err("no such output");
        assert!(error.to_string().contains("resolve_all"), "{error}");
    }
}
