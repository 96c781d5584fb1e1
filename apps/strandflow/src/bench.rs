//! `strandflow bench`: how fast the dynamics are on this machine, scalar doubles beside the packs.

use strandflow_dynamics::bench;

use crate::{args::BenchArgs, failure::Failed};

/// Strands of the three hairstyles of Table 1.
const PAPER_STRANDS: [usize; 3] = [7421, 7403, 7992];

#[expect(clippy::print_stdout, reason = "the table is the data of this command")]
pub fn bench(args: &BenchArgs) -> Result<(), Failed> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut threads = vec![1];
    while threads[threads.len() - 1] * 2 <= cores {
        threads.push(threads[threads.len() - 1] * 2);
    }
    let found = bench::run(args.frames as usize, &threads);
    println!(
        "{} lanes of f32; peak {:.1} Gflop/s and {:.1} GB/s of one thread",
        found.lanes,
        found.peak / 1e9,
        found.stream / 1e9
    );
    println!(
        "{:<28}{:>12}{:>11}{:>8}{:>10}{:>10}{:>11}{:>11}{:>11}",
        "kernel (per problem)",
        "scalar ms",
        "packs ms",
        "times",
        "kflop",
        "Gflop/s",
        "flop/byte",
        "% of roof",
        "% of peak"
    );
    for row in &found.rows {
        let name = if row.name == "strand" { format!("strand of {} frames", args.frames) } else { row.name.into() };
        print!("{name:<28}{:>12.5}{:>11.5}{:>8.1}", row.scalar_ms, row.packs_ms, row.scalar_ms / row.packs_ms);
        if let (Some(operations), Some(bytes)) = (row.operations, row.bytes) {
            let rate = operations as f64 / row.packs_ms * 1e3;
            let intensity = operations as f64 / bytes as f64;
            let roof = found.peak.min(intensity * found.stream);
            print!(
                "{:>10.1}{:>10.1}{intensity:>11.1}{:>11.0}{:>11.0}",
                operations as f64 / 1e3,
                rate / 1e9,
                100.0 * rate / roof,
                100.0 * rate / found.peak
            );
        }
        println!();
    }
    for (threads, rate) in &found.sweep {
        println!("{threads} threads: {rate:.1} strands of {} frames a second", args.frames);
    }
    if let Some((threads, rate)) = found.sweep.last() {
        for strands in PAPER_STRANDS {
            let secs = strands as f64 / rate;
            println!("{strands} strands at this rate on {threads} threads: {secs:.0} s");
        }
    }
    Ok(())
}
