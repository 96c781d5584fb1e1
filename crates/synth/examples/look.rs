//! Writes pictures of a synthetic capture as PPM files: `look DIR [straight|wavy|curly] [demo|full] [FRAME VIEW]...`.
//! With `all` instead of frames and views it renders the whole take and says how long that took.

use std::{env, fs, io::Write, path::Path, time::Instant};

use strandflow_core::RgbImage;
use strandflow_synth::{Style, SynthSpec, generate};

fn main() -> std::io::Result<()> {
    let args: Vec<String> = env::args().skip(1).collect();
    let word = |i: usize, default: &str| args.get(i).cloned().unwrap_or_else(|| default.to_owned());
    let dir = word(0, ".");
    let style = match word(1, "straight").as_str() {
        "wavy" => Style::Wavy,
        "curly" => Style::Curly,
        _ => Style::Straight,
    };
    let spec = if word(2, "demo") == "full" { SynthSpec::full(style, 30) } else { SynthSpec::demo(style) };
    let start = Instant::now();
    let scene = generate(&spec).map_err(|violations| std::io::Error::other(format!("{violations:?}")))?;
    eprintln!("generated in {:.1} s", start.elapsed().as_secs_f64());
    if word(3, "") == "all" {
        let start = Instant::now();
        let seen: usize = (0..spec.rig.frames).map(|frame| scene.render(frame).len()).sum();
        eprintln!("{seen} pictures in {:.1} s", start.elapsed().as_secs_f64());
        let stable = scene.stable(8.0);
        eprintln!("{} of {} strands are stable", stable.iter().filter(|&&s| s).count(), stable.len());
        return Ok(());
    }
    let numbers: Vec<usize> = args.iter().skip(3).filter_map(|a| a.parse().ok()).collect();
    for pair in if numbers.len() >= 2 { &numbers[..] } else { &[0, 3] }.chunks_exact(2) {
        let start = Instant::now();
        let picture = scene.render_view(pair[1], pair[0]);
        eprintln!("rendered in {:.2} s; markers seen {:.2?}", start.elapsed().as_secs_f64(), picture.visible);
        write_ppm(&Path::new(&dir).join(format!("frame{:03}_view{}.ppm", pair[0], pair[1])), &picture.image)?;
    }
    Ok(())
}

fn write_ppm(path: &Path, image: &RgbImage) -> std::io::Result<()> {
    let mut file = fs::File::create(path)?;
    write!(file, "P6\n{} {}\n255\n", image.width, image.height)?;
    file.write_all(image.data.as_flattened())
}
