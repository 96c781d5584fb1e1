use super::*;

const POINTS: [DVec2; 3] = [DVec2::new(0.3, -0.2), DVec2::new(-0.45, 0.35), DVec2::new(0.02, 0.01)];
const RATIONAL: [f64; 8] = [-0.28, 0.09, 1.5e-3, -7e-4, -0.012, 0.04, -0.01, 0.003];
const PRISM: [f64; 4] = [2e-3, -5e-4, -1e-3, 3e-4];
const RADIAL: [f64; 4] = [-0.03, 0.012, -0.004, 0.0007];

fn tilted_by(x: f64, y: f64) -> Distortion {
    let mut terms = [0.0; 14];
    terms[..8].copy_from_slice(&RATIONAL);
    terms[8..12].copy_from_slice(&PRISM);
    (terms[12], terms[13]) = (x, y);
    Distortion::Tilted(terms)
}

/// Every model with the images of `POINTS`: of OpenCV 5 (`projectPoints`, `fisheye.projectPoints`) for the first four, of the
/// published formulas in numpy for the others.
fn models() -> [(Distortion, [[f64; 2]; 3]); 7] {
    let fisheye = PolynomialLens { fisheye: true, radial: RADIAL, ..PolynomialLens::default() };
    let prism = PolynomialLens { tangential: [1e-3, -6e-4], prism: [8e-4, -5e-4], ..fisheye };
    let frame = PolynomialLens { fisheye: false, prism: [0.0; 2], skew: 0.004, ..prism };
    [
        (
            Distortion::BrownConrady(RATIONAL),
            [
                [0.28768017581182487, -0.19165245054121663],
                [-0.4092081665023236, 0.31858357394625164],
                [0.019996490563943224, 0.009999170281971613],
            ],
        ),
        (
            tilted_by(0.0, 0.0),
            [
                [0.28793172581182486, -0.19177738054121662],
                [-0.4086109790023236, 0.3182902614462516],
                [0.019997490438943225, 0.009998670356971611],
            ],
        ),
        (
            tilted_by(0.02, -0.03),
            [
                [0.28945251424473006, -0.19256843346755903],
                [-0.40639806561992003, 0.3162435140738647],
                [0.02002251520009355, 0.01002069292773388],
            ],
        ),
        (
            Distortion::Polynomial(fisheye),
            [
                [0.28694169034074146, -0.191294460227161],
                [-0.4060203810244708, 0.31579362968569946],
                [0.019996367876179737, 0.009998183938089869],
            ],
        ),
        (
            Distortion::Polynomial(prism),
            [
                [0.2867556196281851, -0.19109457238248415],
                [-0.4064276196508403, 0.3162863636423515],
                [0.01999638786951563, 0.009998393868116693],
            ],
        ),
        (
            Distortion::Polynomial(frame),
            [
                [0.29778635620855837, -0.19897684238539998],
                [-0.445486619520789, 0.3477447990019531],
                [0.02003932130010998, 0.010000310029995001],
            ],
        ),
        (
            Distortion::Fov(0.9),
            [
                [0.30988475430807605, -0.20658983620538407],
                [-0.44153932075169844, 0.3434194716957654],
                [0.021465775195447224, 0.010732887597723612],
            ],
        ),
    ]
}

#[test]
fn every_model_agrees_with_values_computed_elsewhere_and_is_undone() {
    for (lens, expected) in models() {
        for (point, expected) in POINTS.into_iter().zip(expected) {
            let seen = distort(&lens, point);
            assert!((seen - DVec2::from(expected)).length() < 1e-14, "{lens:?} {point} {seen}");
            assert!((undistort(&lens, seen) - point).length() < 1e-12, "{lens:?} {point}");
        }
    }
}

#[test]
fn wide_fisheyes_are_undone_up_to_ninety_degrees() {
    let lens = Distortion::Polynomial(PolynomialLens { fisheye: true, radial: RADIAL, ..PolynomialLens::default() });
    for degrees in [0.0, 1e-7, 45.0, 80.0, 89.0_f64] {
        let n = DVec2::from_angle(0.7) * degrees.to_radians().tan();
        let back = undistort(&lens, distort(&lens, n));
        assert!((back - n).length() <= 1e-10 * (1.0 + n.length_squared()), "{degrees} {back}");
    }
    assert!(undistort(&lens, DVec2::new(1.9, 0.3)).is_finite(), "beyond 90 degrees");
    for angle in [0.0, 0.3, 1.2] {
        let lens = Distortion::Fov(angle);
        for n in [DVec2::ZERO, DVec2::new(1e-12, 0.0), DVec2::new(0.7, 1.3)] {
            assert!((undistort(&lens, distort(&lens, n)) - n).length() < 1e-11, "{angle} {n}");
        }
    }
}
