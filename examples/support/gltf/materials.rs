//! What surfaces reflect and emit. A surface has one colour here: each triangle has the mean of its texture, and those of
//! about the same colour share it.

use std::{
    collections::{BTreeMap, HashMap},
    f64::consts::PI,
    rc::Rc,
};

use deep_screen_space::{
    AlphaWrap,
    glam::{DVec2, DVec3},
    scenes::Material,
};
use gltf::{Primitive, Semantic, material::AlphaMode};

use super::{
    File,
    accessors::{Role, Values},
    images::{AlphaMap, Sampler},
    primitives::Shape,
};

/// Materials that a primitive may become.
const MOST: usize = 64;
/// Steps of a colour's square root.
const STEPS: [f64; 6] = [32.0, 16.0, 8.0, 4.0, 2.0, 1.0];
/// The brightest that a surface may be.
const BRIGHTEST: f64 = 1e18;

/// A run of triangles of one material.
pub struct Group {
    pub first: usize,
    pub count: usize,
    pub material: Material,
    pub hole: Option<Hole>,
}

/// Where a material has holes.
#[derive(Clone)]
pub struct Hole {
    /// The number of its image in the file, and the image's alpha.
    pub image: usize,
    pub map: Rc<AlphaMap>,
    pub threshold: f32,
    pub wrap: [AlphaWrap; 2],
}

impl Hole {
    fn key(&self) -> [u32; 4] {
        let [u, v] = self.wrap.map(|wrap| wrap as u32);
        [self.image as u32, self.threshold.to_bits(), u, v]
    }
}

/// A scene's materials, each once.
#[derive(Default)]
pub struct Materials {
    pub list: Vec<Material>,
    /// Of each.
    pub holes: Vec<Option<Hole>>,
    known: HashMap<([u32; 7], Option<[u32; 4]>), u32>,
}

impl Materials {
    pub fn index(&mut self, material: Material, hole: Option<&Hole>) -> u32 {
        let [r, g, b] = material.albedo.map(f32::to_bits);
        let [x, y, z] = material.emission.map(f32::to_bits);
        let key = [r, g, b, x, y, z, u32::from(material.double_sided)];
        let key = (key, hole.map(Hole::key));
        *self.known.entry(key).or_insert_with(|| {
            self.list.push(material);
            self.holes.push(hole.cloned());
            self.list.len() as u32 - 1
        })
    }
}

/// What a triangle reflects and emits.
#[derive(Clone, Copy)]
struct Look {
    albedo: DVec3,
    emission: DVec3,
}

/// A colour that varies over a primitive.
struct Colors<'a> {
    factor: DVec3,
    texture: Option<(Sampler, Values<'a>)>,
    vertices: Option<Values<'a>>,
}

impl Colors<'_> {
    fn vary(&self) -> bool {
        self.factor != DVec3::ZERO && (self.texture.is_some() || self.vertices.is_some())
    }

    fn of(&self, corners: [u32; 3]) -> DVec3 {
        let mut color = self.factor;
        if let Some((sampler, coordinates)) = &self.texture {
            color *= sampler.mean(corners.map(|i| coordinates.get(i)));
        }
        if let Some(vertices) = &self.vertices {
            let sum: DVec3 = corners.map(|i| DVec3::from(vertices.get(i))).iter().sum();
            color *= sum / 3.0;
        }
        color
    }
}

fn sound(color: DVec3, most: f64) -> [f32; 3] {
    let sound = |c: f64| {
        if c.is_nan() {
            0.0
        } else {
            c.clamp(0.0, most) as f32
        }
    };
    color.to_array().map(sound)
}

/// Gives a shape's triangles their materials, and puts those of one material side by side. `vertices` is where the file has
/// each of the shape's.
pub fn group<'a>(
    file: &File<'a>,
    primitive: &Primitive<'a>,
    vertices: &[u32],
    shape: &mut Shape,
    open: impl Fn(&Semantic, Role) -> Result<Option<Values<'a>>, String>,
) -> Result<(), String> {
    let material = primitive.material();
    let surface = material.pbr_metallic_roughness();
    let double_sided = material.double_sided();
    let to_material = |look: &Look| Material {
        albedo: sound(look.albedo, 1.0),
        emission: sound(look.emission, BRIGHTEST),
        double_sided,
    };
    let cuts = material.alpha_mode() == AlphaMode::Mask;
    let texture = |info: Option<gltf::texture::Info<'a>>, without: f64, cuts: bool| {
        let Some(info) = info else {
            return Ok::<_, String>((1.0, None));
        };
        let Some(sampler) = file.images.sampler(file, &info, cuts) else {
            return Ok((without, None));
        };
        let set = Semantic::TexCoords(sampler.set());
        Ok(match open(&set, Role::TexCoords)? {
            Some(coordinates) => (1.0, Some((sampler, coordinates))),
            None => (without, None),
        })
    };
    let [r, g, b, opacity] = surface.base_color_factor().map(f64::from);
    let (_, base) = texture(surface.base_color_texture(), 1.0, cuts)?;
    let mut hole = None;
    if cuts {
        let cutoff = f64::from(material.alpha_cutoff().unwrap_or(0.5));
        let picture = base.as_ref();
        let picture = picture.and_then(|(sampler, uvs)| Some((sampler, uvs, sampler.alpha()?)));
        // What the picture's alpha has to be; of one without it is 1.
        let least = cutoff / opacity;
        if cutoff > 0.0 && least > 1.0 {
            file.notes
                .add("a primitive all of which is cut out is left out");
            shape.triangles.clear();
            return Ok(());
        }
        if let Some((sampler, uvs, (image, map))) = picture
            && least > 0.0
        {
            let at = |i: &u32| sampler.transformed(DVec2::from(uvs.get(*i)));
            shape.tex_coords = vertices
                .iter()
                .map(|i| at(i).as_vec2().to_array())
                .collect();
            hole = Some(Hole {
                image,
                map,
                threshold: least as f32,
                wrap: sampler.wrap(),
            });
        }
    }
    let albedo = Colors {
        factor: DVec3::new(r, g, b),
        texture: base,
        vertices: open(&Semantic::Colors(0), Role::Colors)?,
    };
    // What glows where its texture says so does not glow all over without it.
    let (share, glow) = texture(material.emissive_texture(), 0.0, false)?;
    let strength = f64::from(material.emissive_strength().unwrap_or(1.0)) * share;
    let emission = Colors {
        // The file has a radiance, candela a square metre; a Lambertian surface's radiosity is π times as much.
        factor: DVec3::from(material.emissive_factor().map(f64::from)) * (PI * strength),
        texture: glow,
        vertices: None,
    };
    if !albedo.vary() && !emission.vary() {
        let look = Look {
            albedo: albedo.factor,
            emission: emission.factor,
        };
        shape.groups = vec![Group {
            first: 0,
            count: shape.triangles.len(),
            material: to_material(&look),
            hole,
        }];
        return Ok(());
    }
    let looks: Vec<Look> = shape
        .triangles
        .iter()
        .map(|triangle| {
            let corners = triangle.map(|i| vertices[i as usize]);
            Look {
                albedo: albedo.of(corners),
                emission: emission.of(corners),
            }
        })
        .collect();
    let mut triangles = Vec::with_capacity(shape.triangles.len());
    for members in alike(&looks) {
        let first = triangles.len();
        let mut sum = Look {
            albedo: DVec3::ZERO,
            emission: DVec3::ZERO,
        };
        let mut total = 0.0;
        for &i in &members {
            let [a, b, c] = shape.triangles[i].map(|k| shape.positions[k as usize]);
            // Of triangles without an area each counts as much.
            let area = (b - a).cross(c - a).length().max(1e-30);
            sum.albedo += area * looks[i].albedo;
            sum.emission += area * looks[i].emission;
            total += area;
            triangles.push(shape.triangles[i]);
        }
        sum.albedo /= total;
        sum.emission /= total;
        shape.groups.push(Group {
            first,
            count: members.len(),
            material: to_material(&sum),
            hole: hole.clone(),
        });
    }
    shape.triangles = triangles;
    Ok(())
}

/// Triangles of about the same look, in as fine steps as make no more than [`MOST`] groups.
fn alike(looks: &[Look]) -> Vec<Vec<usize>> {
    let brightest = |of: fn(&Look) -> DVec3| {
        let most = looks.iter().map(|look| of(look).max_element());
        most.fold(f64::MIN_POSITIVE, f64::max)
    };
    let (albedo, emission) = (brightest(|l| l.albedo), brightest(|l| l.emission));
    let grouped = |steps: f64| {
        let mut groups: BTreeMap<[u8; 6], Vec<usize>> = BTreeMap::new();
        for (i, look) in looks.iter().enumerate() {
            let step = |share: f64| (share.clamp(0.0, 1.0).sqrt() * steps).round() as u8;
            let a = (look.albedo / albedo).to_array().map(step);
            let e = (look.emission / emission).to_array().map(step);
            let key = [a[0], a[1], a[2], e[0], e[1], e[2]];
            groups.entry(key).or_default().push(i);
        }
        groups
    };
    let mut groups = BTreeMap::new();
    for steps in STEPS {
        groups = grouped(steps);
        if groups.len() <= MOST {
            break;
        }
    }
    groups.into_values().collect()
}
