//! The preprocessor of the WGSL in `wgsl/`. Its directives stand alone on their lines:
//!
//! | directive | meaning |
//! |---|---|
//! | `#import name` | The text of the module `name`, where it has not been put in before. |
//! | `#if A && !B \|\| C` … `#else` … `#endif` | The lines that a variant keeps. `!` binds first, then `&&`, then `\|\|`. |
//! | `#needs a b` | Whoever imports this module declares `a` and `b` at module scope, in any order. |
//!
//! Flags decide what is *bound*; whatever only changes a value is an `override` constant. A flag that is not in
//! [`FLAGS`] is a mistake in spelling and refused, as is every directive that is not one of these. Mistakes are
//! reported with their file and line.
//!
//! `naga_oil` and `wesl` do more (mangled names, modules parsed apart) and were left aside: neither lets a module read a
//! binding that its importer declares, which is what most of the modules here are for, and both parse every module once
//! more at run time.

use std::collections::BTreeSet;

/// Every flag that a variant may set.
pub(crate) const FLAGS: &[&str] = &[
    "ACCUMULATE",
    "ALBEDO",
    "ALPHA_TESTED",
    "AREAS",
    "AVERAGE",
    "BENT",
    "BLEND",
    "BUILD",
    "CLAIM",
    "COARSEN",
    "COLOR",
    "COUNTED",
    "DEFERRED",
    "DEPTH",
    "EDGES",
    "EMITTERS",
    "ENVIRONMENT",
    "FINER",
    "GATHERED",
    "GIVEN",
    "GLOSSY",
    "HITS",
    "INSTANCES",
    "JOINED",
    "LIST",
    "LIT",
    "MATERIAL",
    "MORE",
    "MOTION",
    "NEAR",
    "NORMALS",
    "ONE_SIDED",
    "OCTET",
    "OWN_SURFACE",
    "PAIR",
    "QUAD",
    "RADIANCE",
    "RAYS",
    "RAY_QUERY",
    "RECEIVER",
    "ROUGHNESS",
    "SAMPLES",
    "DISKS",
    "SHADING",
    "SHADOW_MAP",
    "SHADOW_RAYS",
    "SHADOW_TRACED",
    "SHOW",
    "SKY_LIGHT",
    "SMOOTH",
    "SMOOTHED",
    "STATISTICS",
    "SUBGROUP",
    "SUMMED",
    "TWO_LEVELS",
    "VIEW",
    "WIDEN",
];

/// A piece of WGSL by its name.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Module<'a> {
    /// What `#import` calls it.
    pub name: &'a str,
    /// What errors call it.
    pub file: &'a str,
    pub text: &'a str,
}

/// What is wrong with a module, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Mistake {
    /// [`Module::file`].
    pub file: String,
    /// From 1.
    pub line: usize,
    pub problem: String,
}

/// The text of `root` with everything that it imports from `modules`, as a variant with these flags has it.
pub(crate) fn preprocess(
    root: Module<'_>,
    modules: &[Module<'_>],
    flags: &[&str],
) -> Result<String, Mistake> {
    let mut assembly = Assembly {
        modules,
        flags,
        imported: BTreeSet::new(),
        needs: Vec::new(),
        out: String::with_capacity(2 * root.text.len()),
    };
    assembly.append(root)?;
    let declared = declarations(&assembly.out);
    for (name, mistake) in assembly.needs {
        if !declared.contains(name.as_str()) {
            return Err(mistake);
        }
    }
    Ok(assembly.out)
}

struct Assembly<'a> {
    modules: &'a [Module<'a>],
    flags: &'a [&'a str],
    imported: BTreeSet<&'a str>,
    /// Names that have to be declared, each with the mistake that it is not to be.
    needs: Vec<(String, Mistake)>,
    out: String,
}

/// An `#if` whose `#endif` has not come yet.
struct Open {
    line: usize,
    kept: bool,
    otherwise: bool,
}

impl<'a> Assembly<'a> {
    fn append(&mut self, module: Module<'a>) -> Result<(), Mistake> {
        let mut open: Vec<Open> = Vec::new();
        for (index, line) in module.text.lines().enumerate() {
            let number = index + 1;
            let mistake = |problem: String| Mistake {
                file: module.file.into(),
                line: number,
                problem,
            };
            let kept = open.iter().all(|o| o.kept);
            let Some(directive) = line.trim().strip_prefix('#') else {
                if kept {
                    self.out.push_str(line);
                    self.out.push('\n');
                }
                continue;
            };
            // Directives of lines that are left out are read too: a mistake in them is one in every variant.
            let (word, rest) = directive
                .split_once(char::is_whitespace)
                .unwrap_or((directive, ""));
            let rest = rest.trim();
            let nothing_after = || {
                if rest.is_empty() {
                    Ok(())
                } else {
                    Err(mistake(format!("has {rest:?} after #{word}")))
                }
            };
            match word {
                "if" => open.push(Open {
                    line: number,
                    kept: holds(rest, self.flags).map_err(mistake)?,
                    otherwise: false,
                }),
                "else" => {
                    nothing_after()?;
                    let last = open
                        .last_mut()
                        .ok_or_else(|| mistake("has #else without #if".into()))?;
                    if last.otherwise {
                        return Err(mistake("has a second #else".into()));
                    }
                    last.kept = !last.kept;
                    last.otherwise = true;
                }
                "endif" => {
                    nothing_after()?;
                    open.pop()
                        .ok_or_else(|| mistake("has #endif without #if".into()))?;
                }
                "import" => {
                    let found = self.modules.iter().find(|m| m.name == rest);
                    let found = *found
                        .ok_or_else(|| mistake(format!("imports {rest:?}, which there is not")))?;
                    if kept && self.imported.insert(found.name) {
                        self.append(found)?;
                    }
                }
                "needs" => {
                    let names = rest.split_whitespace().filter(|_| kept);
                    self.needs.extend(names.map(|name| {
                        let problem = format!("needs {name}, which nothing declares");
                        (name.to_owned(), mistake(problem))
                    }));
                }
                _ => return Err(mistake(format!("has the unknown directive #{word}"))),
            }
        }
        match open.last() {
            None => Ok(()),
            Some(open) => Err(Mistake {
                file: module.file.into(),
                line: open.line,
                problem: "has #if without #endif".into(),
            }),
        }
    }
}

/// Whether a condition holds, given the flags that are set.
fn holds(condition: &str, flags: &[&str]) -> Result<bool, String> {
    // Every term is read, so that a mistake is found whatever the others say.
    let mut any = false;
    for all_of in condition.split("||") {
        let mut all = true;
        for term in all_of.split("&&") {
            let term = term.trim();
            let flag = term.strip_prefix('!').unwrap_or(term);
            if !FLAGS.contains(&flag) {
                return Err(format!("has the unknown flag {flag:?}"));
            }
            all &= flags.contains(&flag) != term.starts_with('!');
        }
        any |= all;
    }
    Ok(any)
}

/// Names that WGSL declares at module scope.
fn declarations(text: &str) -> BTreeSet<&str> {
    let mut declared = BTreeSet::new();
    let mut depth = 0_i32;
    for line in text.lines() {
        let code = line.split_once("//").map_or(line, |(code, _)| code);
        if depth == 0 {
            let mut words = code
                .split(|c: char| !(c.is_alphanumeric() || "_<>,".contains(c)))
                .filter(|w| !w.is_empty());
            while let Some(word) = words.next() {
                // `var<storage, read> name`: the address space may be spread over two words.
                let keyword = word.split('<').next().unwrap_or(word);
                if !["fn", "var", "const", "override", "struct", "alias"].contains(&keyword) {
                    continue;
                }
                let name = words.find(|w| !w.contains(['>', '<', ',']));
                declared.extend(name);
                break;
            }
        }
        depth += code.matches('{').count() as i32 - code.matches('}').count() as i32;
    }
    declared
}

#[cfg(test)]
mod tests {
    use super::*;

    fn module<'a>(name: &'a str, text: &'a str) -> Module<'a> {
        Module {
            name,
            file: name,
            text,
        }
    }

    fn run(text: &str, flags: &[&str]) -> Result<String, String> {
        let modules = [
            module("once", "const ONCE = 1u;\n"),
            module(
                "needy",
                "#needs bound\nfn read() -> u32 { return bound[0]; }\n",
            ),
            module("broken", "\n#iff LIST\n"),
        ];
        preprocess(module("root", text), &modules, flags)
            .map_err(|m| format!("{}:{} {}", m.file, m.line, m.problem))
    }

    #[test]
    fn conditions_keep_lines() {
        let lines = |condition: &str, flags: &[&str]| {
            run(&format!("#if {condition}\nyes\n#else\nno\n#endif\n"), flags)
        };
        for (condition, flags, expected) in [
            ("LIST", &["LIST"][..], "yes\n"),
            ("LIST", &[], "no\n"),
            ("!LIST", &["LIST"], "no\n"),
            ("!LIST", &[], "yes\n"),
            ("LIST && LIT", &["LIST"], "no\n"),
            ("LIST && LIT", &["LIT", "LIST"], "yes\n"),
            ("LIST && !LIT", &["LIST"], "yes\n"),
            ("LIST || LIT", &["LIT"], "yes\n"),
            ("LIST || LIT && !LIT", &["LIST"], "yes\n"),
            ("LIST || LIT && !LIT", &["LIT"], "no\n"),
        ] {
            assert_eq!(
                lines(condition, flags).as_deref(),
                Ok(expected),
                "{condition} of {flags:?}"
            );
        }
        let nested = "#if LIST\n#if LIT\na\n#else\nb\n#endif\nc\n#endif\nd\n";
        assert_eq!(run(nested, &["LIT"]).as_deref(), Ok("d\n"));
        assert_eq!(run(nested, &["LIST"]).as_deref(), Ok("b\nc\nd\n"));
    }

    #[test]
    fn modules_are_imported_once() {
        let twice = run("#import once\n#import once\nrest\n", &[]);
        assert_eq!(twice.as_deref(), Ok("const ONCE = 1u;\nrest\n"));
    }

    #[test]
    fn mistakes_name_file_and_line() {
        for (text, expected) in [
            (
                "\n#iff LIST\n#endif\n",
                "root:2 has the unknown directive #iff",
            ),
            (
                "#if LISTS\n#endif\n",
                "root:1 has the unknown flag \"LISTS\"",
            ),
            ("#if\n#endif\n", "root:1 has the unknown flag \"\""),
            (
                "#if LIST LIT\n#endif\n",
                "root:1 has the unknown flag \"LIST LIT\"",
            ),
            (
                "#if LIST\n#else\n#else\n#endif\n",
                "root:3 has a second #else",
            ),
            ("#else\n", "root:1 has #else without #if"),
            ("#endif\n", "root:1 has #endif without #if"),
            (
                "#if LIST\n#endif LIST\n",
                "root:2 has \"LIST\" after #endif",
            ),
            ("a\n#if LIST\n", "root:2 has #if without #endif"),
            (
                "#import twice\n",
                "root:1 imports \"twice\", which there is not",
            ),
            (
                "#import broken\n",
                "broken:2 has the unknown directive #iff",
            ),
            (
                "#import needy\n",
                "needy:1 needs bound, which nothing declares",
            ),
            // Not a declaration: within a function, or in a comment.
            (
                "#import needy\nfn f() {\n  var bound = 1;\n}\n// var bound\n",
                "needy:1 needs bound, which nothing declares",
            ),
        ] {
            assert_eq!(run(text, &[]), Err(expected.into()), "{text:?}");
        }
    }

    #[test]
    fn needs_are_met_by_any_declaration() {
        for declaration in [
            "@group(0) @binding(1) var<storage, read_write> bound: array<u32>;",
            "@group(0) @binding(2) var bound: texture_2d<f32>;",
            "var<private> bound: u32;",
            "const bound = 1u;",
            "@id(1) override bound: u32 = 0u;",
            "struct bound {\n  a: u32,\n}",
            "alias bound = u32;",
            "@must_use fn bound(a: u32) -> u32 {\n  return a;\n}",
        ] {
            let before = run(&format!("{declaration}\n#import needy\n"), &[]);
            assert!(before.is_ok(), "{declaration}: {before:?}");
            let after = run(&format!("#import needy\n{declaration}\n"), &[]);
            assert!(after.is_ok(), "{declaration}: {after:?}");
        }
    }
}
