//! Clear media by name, with the coefficients of Sellmeier's equation.

/// A clear medium of the catalog.
pub(super) struct Glass {
    pub name: &'static str,
    /// Pairs of `B` and `C` (micrometers squared) of Sellmeier's equation.
    pub terms: &'static [[f64; 2]],
}

/// All media. Glasses: Schott's data sheets. The others by the authors named, at room temperature.
pub(super) const CATALOG: &[Glass] = &[
    // Schott, optical glass data sheets
    Glass {
        name: "N-BK7",
        terms: &[
            [1.039_612_12, 0.006_000_698_67],
            [0.231_792_344, 0.020_017_914_4],
            [1.010_469_45, 103.560_653],
        ],
    },
    Glass {
        name: "F2",
        terms: &[
            [1.345_333_59, 0.009_977_438_71],
            [0.209_073_176, 0.047_045_076_7],
            [0.937_357_162, 111.886_764],
        ],
    },
    Glass {
        name: "SF11",
        terms: &[
            [1.738_484_03, 0.013_606_860_4],
            [0.311_168_974, 0.061_596_046_3],
            [1.174_908_71, 121.922_711],
        ],
    },
    Glass {
        name: "N-SF11",
        terms: &[
            [1.737_596_95, 0.013_188_707],
            [0.313_747_346, 0.062_306_814_2],
            [1.898_781_01, 155.236_29],
        ],
    },
    Glass {
        name: "LASF9",
        terms: &[
            [2.000_295_47, 0.012_142_601_7],
            [0.298_926_886, 0.053_873_623_6],
            [1.806_918_43, 156.530_829],
        ],
    },
    Glass {
        name: "N-BAF10",
        terms: &[
            [1.585_149_5, 0.009_266_812_82],
            [0.143_559_385, 0.042_448_980_5],
            [1.085_212_69, 105.613_573],
        ],
    },
    Glass {
        name: "N-FK51A",
        terms: &[
            [0.971_247_817, 0.004_723_019_95],
            [0.216_901_417, 0.015_357_561_2],
            [0.904_651_666, 168.681_33],
        ],
    },
    Glass {
        name: "SF5",
        terms: &[
            [1.461_418_85, 0.011_182_612_6],
            [0.247_713_019, 0.050_859_466_9],
            [0.949_995_832, 112.041_888],
        ],
    },
    Glass {
        name: "SF10",
        terms: &[
            [1.616_259_77, 0.012_753_455_9],
            [0.259_229_334, 0.058_198_395_4],
            [1.077_623_17, 116.607_68],
        ],
    },
    // I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965)
    Glass {
        name: "fused silica",
        terms: &[
            [0.696_166_3, 0.004_679_148_26],
            [0.407_942_6, 0.013_512_063_1],
            [0.897_479_4, 97.934_002_5],
        ],
    },
    // M. Daimon and A. Masumura, Appl. Opt. 46, 3811 (2007), distilled water at 20 degrees Celsius
    Glass {
        name: "water",
        terms: &[
            [0.568_402_756_5, 0.005_101_829_712],
            [0.172_617_739_1, 0.018_211_539_36],
            [0.020_861_895_78, 0.026_207_222_93],
            [0.113_074_868_8, 10.697_927_21],
        ],
    },
    // I. H. Malitson and M. J. Dodge, J. Opt. Soc. Am. 62, 1405 (1972), the ordinary ray
    Glass {
        name: "sapphire",
        terms: &[
            [1.431_349_3, 0.005_279_926_1],
            [0.650_547_13, 0.014_238_264_7],
            [5.341_402_1, 325.017_834],
        ],
    },
    // F. Peter, Z. Phys. 15, 358 (1923)
    Glass { name: "diamond", terms: &[[0.330_6, 0.030_625], [4.335_6, 0.011_236]] },
    // D. L. Wood and K. Nassau, Appl. Opt. 21, 2978 (1982), with 12 % of yttria
    Glass {
        name: "cubic zirconia",
        terms: &[
            [1.347_091, 0.003_911_626_8],
            [2.117_788, 0.027_801_894_1],
            [9.452_943, 591.490_125],
        ],
    },
];

/// Index of the medium of this name; upper and lower case are equal.
pub(super) fn position(name: &str) -> Option<usize> {
    CATALOG.iter().position(|glass| glass.name.eq_ignore_ascii_case(name))
}
