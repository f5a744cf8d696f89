//! Prints the tables of `src/volumetric_obscurance/samples.rs` from their seed: `cargo run --example sample_tables`.

use deep_screen_space::reference::sample_tables::{Domain, generate};

/// Of all tables.
const SEED: u32 = 1;

/// Six of them, as the table has them.
fn digits(value: f64) -> String {
    let plain = format!("{value:.6}");
    let (head, tail) = plain.split_at(plain.len() - 3);
    format!("{head}_{tail}")
}

fn main() {
    for (count, center) in [
        (5, true),
        (7, true),
        (9, true),
        (13, true),
        (16, true),
        (12, false),
        (13, false),
        (15, false),
    ] {
        let table = generate(Domain::Disk, count, center, SEED);
        println!(
            "// {count} {center}: shares within {:.2} %, energy {:.4}",
            100.0 * table.imbalance(),
            table.energy
        );
        for (p, share) in table.points.iter().zip(&table.shares) {
            println!("[{}, {}, {}],", digits(p.x), digits(p.y), digits(*share));
        }
    }
    for count in [6, 12, 33, 64] {
        let table = generate(Domain::Ball, count, false, SEED);
        println!(
            "// {count}: shares within {:.2} %, energy {:.4}",
            100.0 * table.imbalance(),
            table.energy
        );
        for p in &table.points {
            println!("[{}, {}, {}],", digits(p.x), digits(p.y), digits(p.z));
        }
    }
}
