//! The settings of a struct as a table: what the panel shows of each, what the crate accepts, and how Rust writes it.

use deep_screen_space::Error;

/// One setting of `S`.
pub struct Field<S: 'static> {
    /// As Rust calls it.
    pub name: &'static str,
    pub unit: &'static str,
    /// What it does, a line.
    pub help: &'static str,
    pub kind: Kind<S>,
}

/// Where the setting is, and the ends of its slider. A number may be typed beyond those, as far as the crate accepts it.
pub enum Kind<S: 'static> {
    Number(Slider<f32>, fn(&mut S) -> &mut f32),
    Count(Slider<u32>, fn(&mut S) -> &mut u32),
    Flag(fn(&mut S) -> &mut bool),
    Color(Slider<f32>, fn(&mut S) -> &mut [f32; 3]),
}

/// The ends of a slider.
#[derive(Clone, Copy)]
pub struct Slider<T> {
    pub from: T,
    pub to: T,
    pub logarithmic: bool,
    /// Whether infinity is a value that one wants.
    pub endless: bool,
}

/// Even steps.
pub const fn even<T>(from: T, to: T) -> Slider<T> {
    Slider {
        from,
        to,
        logarithmic: false,
        endless: false,
    }
}

/// Even ratios.
pub const fn ratios<T>(from: T, to: T) -> Slider<T> {
    Slider {
        from,
        to,
        logarithmic: true,
        endless: false,
    }
}

/// Even ratios, and infinity.
pub const fn endless<T>(from: T, to: T) -> Slider<T> {
    Slider {
        from,
        to,
        logarithmic: true,
        endless: true,
    }
}

/// A struct of settings.
pub trait Settings: Copy + PartialEq + 'static {
    /// As Rust calls it.
    const TYPE: &'static str;
    /// What `..` stands for in Rust.
    const REST: &'static str;
    const FIELDS: &'static [Field<Self>];

    /// What `REST` is.
    fn rest() -> Self;

    /// The crate's own check.
    ///
    /// # Errors
    /// The first field that is out of range.
    fn check(&self) -> Result<(), Error>;
}

/// What the crate says that it accepts of a field: it is asked about a value that it cannot. `None` where it takes anything.
pub fn accepted<S: Settings>(field: &Field<S>) -> Option<&'static str> {
    let mut wrong = S::rest();
    match &field.kind {
        Kind::Number(_, of) => *of(&mut wrong) = f32::NAN,
        Kind::Count(_, of) => {
            // Either is too much or too little for what has a range.
            *of(&mut wrong) = u32::MAX;
            if wrong.check().is_ok() {
                *of(&mut wrong) = 0;
            }
        }
        Kind::Flag(_) => {}
        Kind::Color(_, of) => *of(&mut wrong) = [f32::NAN; 3],
    }
    match wrong.check() {
        Err(Error::Setting { accepted, .. }) => Some(accepted),
        _ => None,
    }
}

/// A number as Rust writes it.
pub fn number(value: f32) -> String {
    if value == f32::INFINITY {
        "f32::INFINITY".into()
    } else {
        format!("{value:?}")
    }
}

/// A struct as Rust writes it: the fields that differ from what they are otherwise, and the rest.
pub fn rust<S: Settings>(settings: &S) -> String {
    rust_with(settings, &[])
}

/// The same with further fields, by name and value.
pub fn rust_with<S: Settings>(settings: &S, further: &[(&str, String)]) -> String {
    let (mut own, mut rest) = (*settings, S::rest());
    let mut lines: Vec<String> = further
        .iter()
        .map(|(name, value)| format!("    {name}: {value},\n"))
        .collect();
    for field in S::FIELDS {
        let value = match &field.kind {
            Kind::Number(_, of) => (*of(&mut own) != *of(&mut rest)).then(|| number(*of(&mut own))),
            Kind::Count(_, of) => {
                (*of(&mut own) != *of(&mut rest)).then(|| of(&mut own).to_string())
            }
            Kind::Flag(of) => (*of(&mut own) != *of(&mut rest)).then(|| of(&mut own).to_string()),
            Kind::Color(_, of) => (*of(&mut own) != *of(&mut rest)).then(|| color(*of(&mut own))),
        };
        if let Some(value) = value {
            lines.push(format!("    {}: {value},\n", field.name));
        }
    }
    if lines.is_empty() {
        return S::REST.into();
    }
    format!("{} {{\n{}    ..{}\n}}", S::TYPE, lines.concat(), S::REST)
}

/// A colour as Rust writes it.
pub fn color(value: [f32; 3]) -> String {
    let [r, g, b] = value.map(number);
    if r == g && g == b {
        format!("[{r}; 3]")
    } else {
        format!("[{r}, {g}, {b}]")
    }
}
