//! What command lines have in common.

/// `WxH`, 1 to 8192 each.
pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let wrong = || "a width and a height in pixels, WxH, 1 to 8192 each".to_string();
    let (w, h) = text.split_once('x').ok_or_else(wrong)?;
    let parse = |t: &str| {
        t.parse()
            .ok()
            .filter(|n| (1..=8192).contains(n))
            .ok_or_else(wrong)
    };
    Ok([parse(w)?, parse(h)?])
}
