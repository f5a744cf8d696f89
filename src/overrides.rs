//! The `override` constants of a caller's WGSL, and whether the values that it gives fit them.

use crate::{
    error::Error,
    gpu::tokens::{tokens, without_comments},
};

/// An `override` of a source.
#[derive(Debug, PartialEq)]
struct Override<'a> {
    /// Its name, or the number of its `@id`.
    key: &'a str,
    /// Its type, where it says one.
    kind: Option<&'a str>,
    /// Whether it has a value of its own.
    has_default: bool,
}

/// [`Error::Effect`] for a value of an unknown constant, one that its type does not hold, and for a constant without a value.
pub(crate) fn check_constants(
    label: &str,
    source: &str,
    constants: &[(String, f64)],
) -> Result<(), Error> {
    let bad = |problem: String| {
        Err(Error::Effect {
            label: label.into(),
            problem,
        })
    };
    let source = without_comments(source);
    let tokens = tokens(&source);
    let known = overrides(&tokens);
    for (key, value) in constants {
        let Some(found) = known.iter().find(|o| o.key == key) else {
            let keys: Vec<_> = known.iter().map(|o| o.key).collect();
            return bad(format!(
                "has no override constant {key}; those that it has are {keys:?}"
            ));
        };
        let held = match found.kind {
            Some("bool") => !value.is_nan(),
            Some("i32") => (f64::from(i32::MIN)..=f64::from(i32::MAX)).contains(value),
            Some("u32") => (0.0..=f64::from(u32::MAX)).contains(value),
            _ => value.abs() <= f64::from(f32::MAX),
        };
        if !held {
            return bad(format!(
                "is given {value} for its override constant {key}, which is {}",
                found.kind.unwrap_or("a number")
            ));
        }
    }
    match known
        .iter()
        .find(|o| !o.has_default && constants.iter().all(|(key, _)| key != o.key))
    {
        Some(o) => bad(format!(
            "is given no value for its override constant {}",
            o.key
        )),
        None => Ok(()),
    }
}

fn overrides<'a>(tokens: &[&'a str]) -> Vec<Override<'a>> {
    (0..tokens.len())
        .filter(|&at| tokens[at] == "override")
        .filter_map(|at| {
            let name = *tokens.get(at + 1)?;
            let id = match at.checked_sub(5).map(|start| &tokens[start..at]) {
                Some(&["@", "id", "(", id, ")"]) => Some(id),
                _ => None,
            };
            let declared = &tokens[at + 2..];
            let end = declared.iter().position(|t| *t == ";")?;
            let declared = &declared[..end];
            Some(Override {
                key: id.unwrap_or(name),
                kind: match declared {
                    [":", kind, ..] => Some(kind),
                    _ => None,
                },
                has_default: declared.contains(&"="),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_those_of_the_source() {
        let source = "
            // override COMMENTED: f32;
            /* override /* NESTED */: f32; */
            override WIDTH: f32 = 2.0; override COUNT : u32;
            @id(7) override NUMBERED = 1.0;
            fn f() -> f32 { let overrides = WIDTH; return overrides; }";
        let check = |constants: &[(&str, f64)]| {
            let constants: Vec<_> = constants.iter().map(|&(k, v)| (k.into(), v)).collect();
            check_constants("test", source, &constants)
        };
        assert_eq!(check(&[("COUNT", 3.0)]), Ok(()));
        assert_eq!(
            check(&[("COUNT", 3.0), ("WIDTH", -1.0), ("7", 1.0)]),
            Ok(())
        );
        for (constants, named) in [
            (&[][..], "COUNT"),
            (&[("COUNT", 1.0), ("COMMENTED", 1.0)], "COMMENTED"),
            (&[("COUNT", 1.0), ("NESTED", 1.0)], "NESTED"),
            (&[("COUNT", 1.0), ("NUMBERED", 1.0)], "NUMBERED"),
            (&[("COUNT", -1.0)], "-1"),
            (&[("COUNT", 1.0), ("WIDTH", f64::NAN)], "NaN"),
            (&[("COUNT", 1.0), ("WIDTH", 1e39)], "WIDTH"),
        ] {
            let error = check(constants).expect_err(named).to_string();
            assert!(error.contains(named), "{error}");
        }
    }
}
