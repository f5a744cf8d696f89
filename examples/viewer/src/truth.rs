//! The truth about what is seen, by rays traced on the processor, in a thread of its own: refined for as long as one waits.

use std::{
    num::NonZero,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    thread,
};

use deep_screen_space::{
    Bounces, Camera, Material,
    glam::{DQuat, DVec3},
    reference::{
        environment::Cells,
        gbuffer,
        trace::{BentEstimate, ColorEstimate, Estimate, Gloss, Receiver as Point, Tracer},
    },
};
use support::sky;

use crate::{
    flight::Pose,
    look::{Effect, Look},
    place::Place,
};

/// What is to be known.
#[derive(Clone)]
pub struct Question {
    pub place: Arc<Place>,
    /// Where the moving object is.
    pub rounds: Option<f32>,
    pub pose: Pose,
    pub size: [u32; 2],
    pub look: Look,
    /// Rays per pixel until it is known well enough.
    pub rays: u32,
}

impl Question {
    /// Whether the answer to the other, but for the number of rays, answers this one too.
    fn is_as(&self, other: &Self) -> bool {
        self.place.id == other.place.id
            && self.rounds == other.rounds
            && self.pose == other.pose
            && self.size == other.size
            && self.look.effect == other.look.effect
            && self.look.asks() == other.look.asks()
    }
}

/// How often light bounces over frames, nearly.
const OVER_FRAMES: u32 = 12;

impl Look {
    /// Whether the truth about it can be traced.
    pub fn has_truth(&self) -> bool {
        self.effect.has_truth() && (!self.is_lit() || self.sky_radiance == [0.0; 3])
    }

    /// Bounces of light.
    fn bounces(&self) -> u32 {
        match self.further_bounces().map(|bounces| bounces.bounces) {
            None => 1,
            Some(Bounces::InFrame(bounces)) => bounces,
            Some(Bounces::OverFrames) => OVER_FRAMES,
        }
    }

    /// What else the truth of an effect depends on.
    fn asks(&self) -> (f32, u32, usize, f32, [f32; 3]) {
        match self.effect {
            Effect::IndirectDiffuse => (0.0, self.bounces(), 0, 0.0, [0.0; 3]),
            Effect::IndirectSpecular => (0.0, 0, 0, self.roughness, self.f0),
            Effect::DirectionalOcclusion => (self.radius, 0, self.sky, 0.0, [0.0; 3]),
            _ => (self.radius, 0, 0, 0.0, [0.0; 3]),
        }
    }

    /// Whether the truth about another look is the truth about this one.
    pub fn shares_truth(&self, other: &Self) -> bool {
        self.effect == other.effect && self.asks() == other.asks()
    }
}

/// What is known by now.
#[derive(Clone, Debug, Default)]
pub struct Answer {
    pub rays: u32,
    pub size: [u32; 2],
    /// Alpha is 1 where something is seen, 0 for the sky.
    pub texels: Vec<[f32; 4]>,
    /// Root mean square of its own standard errors.
    pub noise: f64,
}

/// How far a picture is off an answer, over the pixels that show something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Off {
    /// Root mean square, the answer's own noise taken out.
    pub rmse: f64,
    pub bias: f64,
    /// Of the truth.
    pub mean: f64,
}

impl Answer {
    /// How far a picture of the same size is off; `None` where it is not, or nothing is seen.
    pub fn off(&self, picture: &[[f32; 3]]) -> Option<Off> {
        if picture.len() != self.texels.len() {
            return None;
        }
        let (mut squares, mut bias, mut mean, mut count) = (0.0, 0.0, 0.0, 0_u32);
        for (picture, [r, g, b, known]) in picture.iter().zip(&self.texels) {
            if *known == 0.0 {
                continue;
            }
            let truth = DVec3::from([r, g, b].map(|v| f64::from(*v)));
            let error = DVec3::from(picture.map(f64::from)) - truth;
            squares += error.length_squared() / 3.0;
            bias += error.element_sum() / 3.0;
            mean += truth.element_sum() / 3.0;
            count += 1;
        }
        let n = f64::from(count);
        (count > 0).then(|| Off {
            rmse: (squares / n - self.noise * self.noise).max(0.0).sqrt(),
            bias: bias / n,
            mean: mean / n,
        })
    }
}

/// What the thread says.
#[derive(Default)]
struct Said {
    answer: Option<Answer>,
    /// Of all rays that were asked for.
    progress: f32,
    problem: Option<String>,
}

/// What both know.
#[derive(Default)]
struct Shared {
    /// Which question is the last.
    last: AtomicU64,
    said: Mutex<Said>,
}

/// The thread, and what it was asked.
pub struct Truth {
    shared: Arc<Shared>,
    questions: Sender<(u64, Question)>,
    asked: Option<Question>,
}

impl Truth {
    pub fn new() -> Self {
        let (questions, asked) = channel();
        let shared = Arc::<Shared>::default();
        let of_thread = Arc::clone(&shared);
        // What panics in it has no more answers, and takes nothing else along.
        thread::spawn(move || work(&asked, &of_thread));
        Self {
            shared,
            questions,
            asked: None,
        }
    }

    /// Asks, unless that is what was asked last. True where what was known is of no more use.
    pub fn ask(&mut self, question: Question) -> bool {
        let asked = self.asked.as_ref();
        if asked.is_some_and(|asked| asked.is_as(&question) && asked.rays >= question.rays) {
            return false;
        }
        let ticket = self.stop();
        let sent = self.questions.send((ticket, question.clone()));
        if sent.is_err() {
            let mut said = lock(&self.shared.said);
            said.problem = Some("the ray tracer has ended".into());
        }
        self.asked = Some(question);
        true
    }

    /// Nothing is to be known.
    pub fn forget(&mut self) {
        if self.asked.take().is_some() {
            self.stop();
        }
    }

    fn stop(&self) -> u64 {
        let ticket = self.shared.last.fetch_add(1, Ordering::Relaxed) + 1;
        *lock(&self.shared.said) = Said::default();
        ticket
    }

    pub fn is_asked(&self) -> bool {
        self.asked.is_some()
    }

    /// What is new.
    pub fn take(&self) -> Option<Answer> {
        lock(&self.shared.said).answer.take()
    }

    /// Share of the rays that were asked for.
    pub fn progress(&self) -> f32 {
        lock(&self.shared.said).progress
    }

    pub fn problem(&self) -> Option<String> {
        lock(&self.shared.said).problem.clone()
    }
}

fn lock(said: &Mutex<Said>) -> std::sync::MutexGuard<'_, Said> {
    said.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A scene that can be traced, and which it is.
struct Traced {
    of: (u64, Option<f32>),
    scene: deep_screen_space::scenes::Scene,
    tracer: Tracer,
    materials: Vec<Material>,
}

impl Traced {
    fn new(question: &Question) -> Result<Self, String> {
        let mut scene = question.place.scene.clone();
        question.place.mover.place(&mut scene, question.rounds);
        let tracer = Tracer::of_scene(&scene).map_err(|e| e.to_string())?;
        Ok(Self {
            of: (question.place.id, question.rounds),
            materials: scene.triangle_materials(),
            tracer,
            scene,
        })
    }
}

/// Answers questions until nobody asks any more, on all cores but one.
fn work(questions: &Receiver<(u64, Question)>, shared: &Shared) {
    let cores = thread::available_parallelism().map_or(1, NonZero::get);
    let threads = cores.saturating_sub(1).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let mut traced = None;
    while let Ok(mut newest) = questions.recv() {
        while let Ok(newer) = questions.try_recv() {
            newest = newer;
        }
        let (ticket, question) = newest;
        let mut answer = || respond(&question, ticket, &mut traced, shared);
        let answered = match &pool {
            Ok(pool) => pool.install(answer),
            Err(_) => answer(),
        };
        if let Err(problem) = answered {
            lock(&shared.said).problem = Some(problem);
        }
    }
}

/// Rays of a pixel in a round: a picture at once, then in larger steps.
fn rays_in(round: u32) -> u32 {
    1 << round.saturating_sub(1).min(4)
}

/// Rows that are traced before one looks whether something else is asked.
const BAND: usize = 8;

fn respond(
    question: &Question,
    ticket: u64,
    traced: &mut Option<Traced>,
    shared: &Shared,
) -> Result<(), String> {
    let is_last = || shared.last.load(Ordering::Relaxed) == ticket;
    if !is_last() {
        return Ok(());
    }
    let known = (question.place.id, question.rounds);
    if traced.as_ref().is_none_or(|traced| traced.of != known) {
        *traced = Some(Traced::new(question)?);
    }
    let Some(traced) = traced else {
        return Ok(());
    };
    let scene = &traced.scene;
    let camera: Camera = question
        .pose
        .camera(question.size)
        .map_err(|e| e.to_string())?;
    let pixels = gbuffer::cast(
        &camera,
        &traced.tracer,
        &scene.positions,
        &scene.normals,
        &scene.indices,
    );
    let points: Vec<Option<Point>> = pixels.iter().map(|p| Some(p.as_ref()?.receiver)).collect();
    let albedo = |i: usize| {
        pixels[i].as_ref().map_or(DVec3::ZERO, |pixel| {
            DVec3::from(traced.materials[pixel.triangle].albedo.map(f64::from))
        })
    };
    let cells = (question.look.effect == Effect::DirectionalOcclusion)
        .then(|| sky::by_name(sky::NAMES[question.look.sky % sky::NAMES.len()]))
        .flatten()
        .map(|picture| Cells::new(picture, DQuat::IDENTITY));
    let width = question.size[0] as usize;
    // Rays times means, and the squares of rays times standard errors.
    let mut sums = vec![(DVec3::ZERO, DVec3::ZERO); points.len()];
    let (mut rays, mut round) = (0, 0);
    while rays < question.rays {
        let more = rays_in(round).min(question.rays - rays);
        let weight = f64::from(more);
        for (band, points) in points.chunks(BAND * width).enumerate() {
            if !is_last() {
                return Ok(());
            }
            let first = band * BAND * width;
            // Each pixel of each round has other rays.
            let seed = (u64::from(round) << 32) | band as u64;
            let found = trace(question, traced, cells.as_ref(), points, (more, seed));
            for (i, found) in (first..).zip(found) {
                if let Some(found) = found {
                    let albedo = if question.look.effect == Effect::IndirectDiffuse {
                        albedo(i)
                    } else {
                        DVec3::ONE
                    };
                    sums[i].0 += weight * found.mean * albedo;
                    let off = weight * found.standard_error * albedo;
                    sums[i].1 += off * off;
                }
            }
            let done =
                rays as f32 + more as f32 * (first + points.len()) as f32 / sums.len() as f32;
            let mut said = lock(&shared.said);
            if is_last() {
                said.progress = done / question.rays as f32;
            }
        }
        rays += more;
        round += 1;
        let answer = answer_of(question, &points, &sums, rays);
        let mut said = lock(&shared.said);
        if is_last() {
            said.answer = Some(answer);
        }
    }
    Ok(())
}

fn answer_of(
    question: &Question,
    points: &[Option<Point>],
    sums: &[(DVec3, DVec3)],
    rays: u32,
) -> Answer {
    let n = f64::from(rays);
    let is_direction = question.look.effect == Effect::BentNormals;
    let (mut noise, mut count) = (0.0, 0_u32);
    let texels = points
        .iter()
        .zip(sums)
        .map(|(point, (sum, squares))| {
            if point.is_none() {
                return [0.0; 4];
            }
            noise += squares.element_sum() / (3.0 * n * n);
            count += 1;
            let mean = if is_direction {
                sum.normalize_or_zero()
            } else {
                *sum / n
            };
            mean.as_vec3().extend(1.0).to_array()
        })
        .collect();
    Answer {
        rays,
        size: question.size,
        texels,
        noise: (noise / f64::from(count.max(1))).sqrt(),
    }
}

fn trace(
    question: &Question,
    traced: &Traced,
    cells: Option<&Cells>,
    points: &[Option<Point>],
    (rays, seed): (u32, u64),
) -> Vec<Option<ColorEstimate>> {
    let Traced {
        tracer, materials, ..
    } = traced;
    let look = &question.look;
    let lights = &question.place.lights[..];
    let radius = f64::from(look.radius);
    match (look.effect, cells) {
        (Effect::IndirectDiffuse, _) => {
            let bounces = look.bounces();
            tracer.bounces_image(points, materials, lights, bounces, (rays, seed), false)
        }
        (Effect::IndirectSpecular, _) => {
            let gloss = Gloss {
                eye: question.pose.eye,
                roughness: look.roughness.into(),
                f0: DVec3::from(look.f0.map(f64::from)),
            };
            let sources = (&materials[..], lights);
            tracer.glossy_image(points, &gloss, sources, (rays, seed), false)
        }
        (Effect::DirectionalOcclusion, Some(cells)) => {
            tracer.environment_image(points, cells, (radius, rays), seed, false)
        }
        (Effect::BentNormals, _) => {
            let bent = |e: BentEstimate| ColorEstimate {
                mean: e.mean,
                standard_error: DVec3::ZERO,
            };
            let image = tracer.bent_normal_image(points, radius, rays, seed, false);
            image.into_iter().map(|e| e.map(bent)).collect()
        }
        _ => {
            let grey = |e: Estimate| ColorEstimate {
                mean: DVec3::splat(e.mean),
                standard_error: DVec3::splat(e.standard_error),
            };
            let image = tracer.ambient_occlusion_image(points, radius, rays, seed, false);
            image.into_iter().map(|e| e.map(grey)).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use deep_screen_space::Quality;
    use support::gpu::{Ask, Gpu};

    use super::*;

    /// Rounds of few rays are as good as all of them at once, and what is asked anew is not answered by what was asked before.
    #[test]
    fn rounds_come_to_the_truth() {
        let gpu = Gpu::open(Ask::Floor).unwrap();
        let place = Arc::new(Place::load(&gpu, "cornell").unwrap());
        let question = Question {
            rounds: None,
            pose: place.views[0].1,
            size: [24, 16],
            look: Look::new(2.0, 1.0, Quality::Fast),
            rays: 64,
            place,
        };
        let mut truth = Truth::new();
        assert!(truth.ask(Question {
            pose: Pose {
                yaw: question.pose.yaw + 1.0,
                ..question.pose
            },
            ..question.clone()
        }));
        assert!(truth.ask(question.clone()));
        assert!(!truth.ask(question.clone()));
        let mut answer = Answer::default();
        let began = Instant::now();
        while answer.rays < question.rays {
            assert!(began.elapsed() < Duration::from_mins(1), "no answer");
            assert_eq!(truth.problem(), None);
            if let Some(more) = truth.take() {
                assert!(more.rays > answer.rays);
                answer = more;
            }
            thread::sleep(Duration::from_millis(5));
        }
        assert_eq!(truth.progress(), 1.0);
        let traced = Traced::new(&question).unwrap();
        let scene = &traced.scene;
        let camera = question.pose.camera(question.size).unwrap();
        let points = gbuffer::receivers(
            &camera,
            &traced.tracer,
            &scene.positions,
            &scene.normals,
            &scene.indices,
        );
        let at_once = trace(&question, &traced, None, &points, (1024, 99));
        let picture: Vec<[f32; 3]> = at_once
            .iter()
            .map(|e| e.map_or([0.0; 3], |e| e.mean.as_vec3().to_array()))
            .collect();
        let off = answer.off(&picture).unwrap();
        // Four standard errors of 384 pixels of 64 rays' mean, each of which is off by at most a sixteenth.
        assert!(off.bias.abs() < 4.0 / 16.0 / 384_f64.sqrt(), "{off:?}");
        // The answer's noise is known, that of the 1024 rays is a quarter of it: a sixteenth of a half at most.
        assert!(off.rmse < 0.5 / 16.0, "{off:?}, {}", answer.noise);
        assert!(answer.noise > 0.0 && answer.noise < 1.0 / 16.0);
    }
}
