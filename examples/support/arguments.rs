//! What command lines have in common.

/// The longest side of a picture, in pixels: what textures have within the default limits.
pub const MAX_SIDE: u32 = 8192;

/// `WxH`, 1 to [`MAX_SIDE`] each.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || format!("a width and a height in pixels, WxH, 1 to {MAX_SIDE} each");
    let (w, h) = text.split_once('x').ok_or_else(wrong)?;
    let parse = |t: &str| {
        t.parse()
            .ok()
            .filter(|n| (1..=MAX_SIDE).contains(n))
            .ok_or_else(wrong)
    };
    Ok([parse(w)?, parse(h)?])
}
