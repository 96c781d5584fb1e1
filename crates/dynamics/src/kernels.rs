//! The kernels compiled for each instruction set, and the choice among them at run time.

use crate::{
    lanes::{Lanes, Portable, V3},
    linear::{self, LinearModel, LinearScratch},
    params::LaneParams,
    rest::LaneRest,
    system::StepConstants,
    window::{self, WindowInput, WindowWorkspace},
};

/// A piece of work to be compiled with the vector instructions of its lanes; `run` must be `inline(always)`.
pub trait Job<R> {
    /// What it gives.
    type Output;
    /// Does it.
    fn run(self) -> Self::Output;
}

/// The heavy functions of a lane type, each compiled with the instructions of that type.
pub trait Kernels: Lanes {
    /// Runs a job with this type's instructions.
    fn call<J: Job<Self>>(job: J) -> J::Output;
    /// [`window::simulate`].
    fn simulate(input: &WindowInput<Self>, workspace: &mut WindowWorkspace<Self>);
    /// [`window::evaluate`].
    fn evaluate(input: &WindowInput<Self>, workspace: &mut WindowWorkspace<Self>);
    /// [`window::relax`].
    fn relax(
        rest: &LaneRest<Self>,
        params: &LaneParams<Self>,
        constants: &StepConstants<Self>,
        iterations: usize,
        positions: (&[V3<Self>], &mut [V3<Self>]),
        workspace: &mut WindowWorkspace<Self>,
    );
    /// [`linear::gather`].
    fn gather(model: &LinearModel<Self>, frames: &[V3<Self>], out: &mut [V3<Self>], scratch: &mut LinearScratch<Self>);
    /// [`linear::solve`].
    fn solve(
        model: &LinearModel<Self>,
        rhs: &[V3<Self>],
        out: &mut [V3<Self>],
        iterations: usize,
        scratch: &mut LinearScratch<Self>,
    );
}

macro_rules! kernels {
    ($lanes:ty $(, $feature:literal)?) => {
        impl Kernels for $lanes {
            fn call<J: Job<Self>>(job: J) -> J::Output {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run<J: Job<$lanes>>(job: J) -> J::Output {
                    job.run()
                }
                // SAFETY: values of this lane type exist only where the processor has its instructions.
                unsafe { run(job) }
            }
            fn simulate(input: &WindowInput<Self>, workspace: &mut WindowWorkspace<Self>) {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run(input: &WindowInput<$lanes>, workspace: &mut WindowWorkspace<$lanes>) {
                    window::simulate(input, workspace);
                }
                // SAFETY: values of this lane type exist only where the processor has its instructions.
                unsafe { run(input, workspace) }
            }
            fn evaluate(input: &WindowInput<Self>, workspace: &mut WindowWorkspace<Self>) {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run(input: &WindowInput<$lanes>, workspace: &mut WindowWorkspace<$lanes>) {
                    window::evaluate(input, workspace);
                }
                // SAFETY: as above.
                unsafe { run(input, workspace) }
            }
            fn relax(
                rest: &LaneRest<Self>,
                params: &LaneParams<Self>,
                constants: &StepConstants<Self>,
                iterations: usize,
                positions: (&[V3<Self>], &mut [V3<Self>]),
                workspace: &mut WindowWorkspace<Self>,
            ) {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run(
                    rest: &LaneRest<$lanes>,
                    params: &LaneParams<$lanes>,
                    constants: &StepConstants<$lanes>,
                    iterations: usize,
                    (x_tilde, x): (&[V3<$lanes>], &mut [V3<$lanes>]),
                    workspace: &mut WindowWorkspace<$lanes>,
                ) {
                    window::relax(rest, params, constants, iterations, x_tilde, x, workspace);
                }
                // SAFETY: as above.
                unsafe { run(rest, params, constants, iterations, positions, workspace) }
            }
            fn gather(
                model: &LinearModel<Self>,
                frames: &[V3<Self>],
                out: &mut [V3<Self>],
                scratch: &mut LinearScratch<Self>,
            ) {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run(
                    model: &LinearModel<$lanes>,
                    frames: &[V3<$lanes>],
                    out: &mut [V3<$lanes>],
                    scratch: &mut LinearScratch<$lanes>,
                ) {
                    linear::gather(model, frames, out, scratch);
                }
                // SAFETY: as above.
                unsafe { run(model, frames, out, scratch) }
            }
            fn solve(
                model: &LinearModel<Self>,
                rhs: &[V3<Self>],
                out: &mut [V3<Self>],
                iterations: usize,
                scratch: &mut LinearScratch<Self>,
            ) {
                $(#[target_feature(enable = $feature)])?
                unsafe fn run(
                    model: &LinearModel<$lanes>,
                    rhs: &[V3<$lanes>],
                    out: &mut [V3<$lanes>],
                    iterations: usize,
                    scratch: &mut LinearScratch<$lanes>,
                ) {
                    linear::solve(model, rhs, out, iterations, scratch);
                }
                // SAFETY: as above.
                unsafe { run(model, rhs, out, iterations, scratch) }
            }
        }
    };
}

kernels!(f64);
kernels!(Portable);
kernels!(crate::counted::Counted);
#[cfg(target_arch = "x86_64")]
kernels!(crate::lanes_x86::F32x16, "avx512f,avx512dq,avx512vl,avx2,fma");
#[cfg(target_arch = "x86_64")]
kernels!(crate::lanes_x86::F32x8, "avx2,fma");

/// Work that can run on any lane type.
pub trait LaneTask {
    /// What it gives.
    type Output;
    /// Runs it on this lane type.
    fn run<R: Kernels>(self) -> Self::Output;
}

/// Runs a task on the widest lanes of this processor. The same machine always takes the same.
pub fn on_widest_lanes<T: LaneTask>(task: T) -> T::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if has_avx512() {
            return task.run::<crate::lanes_x86::F32x16>();
        }
        if has_avx2() {
            return task.run::<crate::lanes_x86::F32x8>();
        }
    }
    task.run::<Portable>()
}

/// Runs a task on every kind of lanes that this processor has: scalar doubles first, then packs by their width.
pub fn on_each_lanes<T: LaneTask + Clone>(task: &T) -> Vec<T::Output> {
    #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "no further packs"))]
    let mut all = vec![task.clone().run::<f64>(), task.clone().run::<Portable>()];
    #[cfg(target_arch = "x86_64")]
    {
        if has_avx2() {
            all.push(task.clone().run::<crate::lanes_x86::F32x8>());
        }
        if has_avx512() {
            all.push(task.clone().run::<crate::lanes_x86::F32x16>());
        }
    }
    all
}

#[cfg(target_arch = "x86_64")]
fn has_avx512() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx512f") && has!("avx512dq") && has!("avx512vl") && has!("fma")
}

#[cfg(target_arch = "x86_64")]
fn has_avx2() -> bool {
    use std::arch::is_x86_feature_detected as has;
    has!("avx2") && has!("fma")
}

/// Lanes of [`on_widest_lanes`].
pub fn widest_lane_count() -> usize {
    struct Count;
    impl LaneTask for Count {
        type Output = usize;
        fn run<R: Kernels>(self) -> usize {
            R::COUNT
        }
    }
    on_widest_lanes(Count)
}
