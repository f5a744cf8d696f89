//! How far pictures are off.

/// Root of the mean square difference of two pictures' values.
pub fn rmse(image: &[f32], truth: &[f32]) -> f64 {
    let squares: f64 = image
        .iter()
        .zip(truth)
        .map(|(a, b)| f64::from(a - b).powi(2))
        .sum();
    (squares / image.len() as f64).sqrt()
}
