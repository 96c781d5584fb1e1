//! Gradient-boosted decision trees for two classes with soft targets.
//!
//! Every level of a tree asks one question of all samples (oblivious trees), so that a tree is a table of 2^depth values
//! indexed by the answers. Features are quantised to their own quantiles once; leaves are Newton steps of the logistic loss.
//!
//! Reference: Friedman 2001; Prokhorenkova 2018 (oblivious trees).

/// Cuts of a feature at most; bins are one more and fit a byte.
const CUTS: usize = 47;

/// How trees are grown.
#[derive(Clone, Debug, PartialEq)]
pub struct BoostOptions {
    /// Trees.
    pub trees: usize,
    /// Questions of a tree.
    pub depth: usize,
    /// Share of a Newton step that a tree takes.
    pub rate: f32,
    /// Added to the curvature of every leaf, in samples of the most undecided kind times four.
    pub ridge: f32,
}

impl Default for BoostOptions {
    fn default() -> Self {
        Self { trees: 80, depth: 5, rate: 0.15, ridge: 4.0 }
    }
}

/// A learnt decision: the log odds of the first class from the features of a sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Boosted {
    cuts: Vec<Vec<f32>>,
    base: f32,
    trees: Vec<Tree>,
}

#[derive(Clone, Debug, PartialEq)]
struct Tree {
    /// (feature, bin): the answer is whether the sample's bin is above.
    questions: Vec<(usize, u8)>,
    /// By the answers, the first question being the lowest bit.
    leaves: Vec<f32>,
}

impl Boosted {
    /// Learns from samples given as one slice a feature, with targets 0 to 1 and weights. `None` where a class is empty.
    pub fn learn(features: &[Vec<f32>], target: &[f32], weight: &[f32], options: &BoostOptions) -> Option<Self> {
        let (mut first, mut all) = (0.0f64, 0.0f64);
        for (&y, &w) in target.iter().zip(weight) {
            first += f64::from(y * w);
            all += f64::from(w);
        }
        if first < 1.0 || all - first < 1.0 {
            return None;
        }
        let cuts: Vec<Vec<f32>> = features.iter().map(|f| quantiles(f)).collect();
        let bins: Vec<Vec<u8>> = features.iter().zip(&cuts).map(|(f, c)| binned(f, c)).collect();
        let base = (first / (all - first)).ln() as f32;
        let mut odds = vec![base; target.len()];
        let mut trees = Vec::with_capacity(options.trees);
        for _ in 0..options.trees {
            let slope = |(&o, (&y, &w)): (&f32, (&f32, &f32))| {
                let p = 1.0 / (1.0 + (-o).exp());
                [w * (y - p), w * (p * (1.0 - p)).max(1e-4)]
            };
            let slopes: Vec<[f32; 2]> = odds.iter().zip(target.iter().zip(weight)).map(slope).collect();
            let (tree, at) = Tree::grown(&bins, &slopes, options);
            odds.iter_mut().zip(&at).for_each(|(o, &leaf)| *o += tree.leaves[leaf as usize]);
            trees.push(tree);
        }
        Some(Self { cuts, base, trees })
    }

    /// Log odds of the first class, one value a sample.
    pub fn log_odds(&self, features: &[Vec<f32>]) -> Vec<f32> {
        let bins: Vec<Vec<u8>> = features.iter().zip(&self.cuts).map(|(f, c)| binned(f, c)).collect();
        let mut odds = vec![self.base; features.first().map_or(0, Vec::len)];
        // So many samples stay in the nearest cache over all trees.
        const BLOCK: usize = 1024;
        for (block, odds) in odds.chunks_mut(BLOCK).enumerate() {
            let (start, count) = (block * BLOCK, odds.len());
            let mut at = [0u8; BLOCK];
            for tree in &self.trees {
                at.fill(0);
                for (k, &(feature, cut)) in tree.questions.iter().enumerate() {
                    let column = &bins[feature][start..start + count];
                    at.iter_mut().zip(column).for_each(|(a, &b)| *a |= u8::from(b > cut) << k);
                }
                odds.iter_mut().zip(&at).for_each(|(o, &a)| *o += tree.leaves[a as usize]);
            }
        }
        odds
    }
}

impl Tree {
    /// A tree along the slopes (gradient, curvature), and the leaf of every sample.
    fn grown(bins: &[Vec<u8>], slopes: &[[f32; 2]], options: &BoostOptions) -> (Self, Vec<u8>) {
        let mut at = vec![0u8; slopes.len()];
        let mut questions = Vec::with_capacity(options.depth);
        let ridge = 0.25 * options.ridge;
        for level in 0..options.depth.min(7) {
            let mut best = (f32::MIN, (0, 0));
            for (feature, sums) in histograms(bins, &at, slopes, 1 << level).iter().enumerate() {
                let (gain, cut) = best_cut(sums, ridge);
                if gain > best.0 {
                    best = (gain, (feature, cut));
                }
            }
            let (feature, cut) = best.1;
            at.iter_mut().zip(&bins[feature]).for_each(|(a, &b)| *a |= u8::from(b > cut) << level);
            questions.push(best.1);
        }
        let mut sums = vec![[0.0f32; 2]; 1 << questions.len()];
        for (&leaf, [g, h]) in at.iter().zip(slopes) {
            sums[leaf as usize][0] += g;
            sums[leaf as usize][1] += h;
        }
        let leaves = sums.iter().map(|[g, h]| options.rate * g / (h + ridge)).collect();
        (Self { questions, leaves }, at)
    }
}

/// Values of a feature that are told apart.
const BINS: usize = CUTS + 1;

/// Sums of gradient and curvature.
type Sums = [f32; 2];

/// The sums over the samples of each bin of each leaf, one row of `leaves` × [`BINS`] a feature.
fn histograms(bins: &[Vec<u8>], at: &[u8], slopes: &[Sums], leaves: usize) -> Vec<Vec<Sums>> {
    // Samples beside each other often fall into one bin, and each sum waits for the one before: several at once.
    const TOGETHER: usize = 4;
    let mut all = vec![vec![[0.0f32; 2]; leaves * BINS]; bins.len()];
    for (columns, sums) in bins.chunks(TOGETHER).zip(all.chunks_mut(TOGETHER)) {
        match (columns, sums) {
            ([a, b, c, d], [p, q, r, s]) => fill([a, b, c, d], at, slopes, [p, q, r, s]),
            (columns, sums) => columns.iter().zip(sums).for_each(|(column, sums)| fill([column], at, slopes, [sums])),
        }
    }
    all
}

/// The histograms of `N` features in one pass over the samples.
fn fill<const N: usize>(columns: [&[u8]; N], at: &[u8], slopes: &[Sums], mut all: [&mut [Sums]; N]) {
    for (i, (&leaf, [g, h])) in at.iter().zip(slopes).enumerate() {
        for (column, sums) in columns.iter().zip(&mut all) {
            let sum = &mut sums[leaf as usize * BINS + column[i] as usize];
            *sum = [sum[0] + g, sum[1] + h];
        }
    }
}

/// The cut of a feature that explains most over all leaves so far, and how much.
fn best_cut(sums: &[Sums], ridge: f32) -> (f32, u8) {
    let mut gains = [0.0f32; BINS];
    for leaf in sums.chunks(BINS) {
        let total = leaf.iter().fold([0.0f32; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
        let mut low = [0.0f32; 2];
        for (gain, bin) in gains.iter_mut().zip(leaf) {
            low = [low[0] + bin[0], low[1] + bin[1]];
            let high = [total[0] - low[0], total[1] - low[1]];
            *gain += low[0] * low[0] / (low[1] + ridge) + high[0] * high[0] / (high[1].max(0.0) + ridge);
        }
    }
    let mut best = (f32::MIN, 0);
    for (cut, &gain) in gains[..CUTS].iter().enumerate() {
        if gain > best.0 {
            best = (gain, cut as u8);
        }
    }
    best
}

/// Up to [`CUTS`] different values that split the samples evenly.
fn quantiles(values: &[f32]) -> Vec<f32> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f32::total_cmp);
    let mut cuts: Vec<f32> = (1..=CUTS).map(|k| sorted[k * (sorted.len() - 1) / (CUTS + 1)]).collect();
    cuts.dedup();
    cuts
}

fn binned(values: &[f32], cuts: &[f32]) -> Vec<u8> {
    // The number of cuts below each value, bit by bit and without branches: the samples have no order to predict.
    const STEPS: u32 = (CUTS + 1).next_power_of_two().ilog2();
    let mut ladder = [f32::INFINITY; 1 << STEPS];
    ladder[..cuts.len()].copy_from_slice(cuts);
    let bin = |value: &f32| {
        let below = (0..STEPS).rev().fold(0usize, |below, k| {
            below + (usize::from(ladder[(below + (1 << k) - 1) % ladder.len()] < *value) << k)
        });
        below as u8
    };
    values.iter().map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bin_is_the_number_of_cuts_below() {
        for count in [0, 1, 5, CUTS] {
            let cuts: Vec<f32> = (0..count).map(|k| 0.5 * k as f32 - 3.0).collect();
            let values: Vec<f32> =
                (-60..120).map(|k| 0.25 * k as f32).chain([f32::INFINITY, f32::NEG_INFINITY]).collect();
            let expected: Vec<u8> = values.iter().map(|v| cuts.partition_point(|c| c < v) as u8).collect();
            assert_eq!(binned(&values, &cuts), expected);
        }
    }

    #[test]
    fn a_ring_is_told_from_its_inside_and_outside() {
        let at = |i: usize| [(i % 60) as f32 / 30.0 - 1.0, (i / 60) as f32 / 30.0 - 1.0];
        let columns: Vec<Vec<f32>> = (0..2).map(|k| (0..3600).map(|i| at(i)[k]).collect()).collect();
        let ring = |i: usize| f32::from(u8::from((0.4..0.8).contains(&at(i)[0].hypot(at(i)[1]))));
        let target: Vec<f32> = (0..3600).map(ring).collect();
        let options = BoostOptions { trees: 160, ..BoostOptions::default() };
        let model = Boosted::learn(&columns, &target, &[1.0; 3600], &options).unwrap();
        let wrong = model.log_odds(&columns).iter().zip(&target).filter(|(o, y)| (**o > 0.0) != (**y > 0.5)).count();
        assert!(wrong < 72, "{wrong}");
        assert!(Boosted::learn(&columns, &[1.0; 3600], &[1.0; 3600], &BoostOptions::default()).is_none());
    }

    #[test]
    fn without_a_feature_that_tells_them_apart_the_odds_are_those_of_the_classes() {
        let columns = vec![(0..4000).map(|i| (i % 10) as f32).collect::<Vec<f32>>()];
        let target: Vec<f32> = (0..4000).map(|i| if i / 10 % 4 == 0 { 1.0 } else { 0.0 }).collect();
        let model = Boosted::learn(&columns, &target, &[1.0; 4000], &BoostOptions::default()).unwrap();
        assert!(model.log_odds(&columns).iter().all(|o| (o + 3f32.ln()).abs() < 0.05));
    }
}
