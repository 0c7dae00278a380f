"""The constants of the method `gp` that matter: symbol of research/local-field.md, unit, and reason.

benchmarks/results/gp_constants.md has a row of each name but those of the detail: what half and twice its value change.
"Ablation:" names the row of benchmarks/results/gp_ablation.md that shows what the rule is worth.
"""

# Density, Eqs. (3) and (4). Ablation: "density off".
DENSITY_POWER = 2.0  # p: power of the roughness, at a feature weight of 1.
# q_0: roughness of flat places, so that they are not left bare. Without it, H max is 6 % larger; 0.03 is as good and
# 0.1 is 1 % worse in H mean (research/experiments.md, "floor of the roughness").
MIN_ROUGHNESS = 0.05
GRADATION = 0.1  # Largest growth of the spacing with distance. Ablation: "gradation off".
EDGE_ROUGHNESS = 0.29  # Roughness on a right-angled edge: 0.292 at any radius. Ablation: "segregation off".
ROUNDNESS_POWER = 4.0  # Of 1 - S^2 for a segregation S. The larger, the less flat faces with edges count as round.
# Power of users' weights. Near a jump of the weights, and where normals turn much from one point to the next, the
# choice follows the desired spacings less than it should; with this power, densities have the ratio (docs/ask.md).
WEIGHT_POWER = 1.15
MAX_REFINEMENT = 8.0  # Times the usual number of candidates at most, where large weights ask for many points.

# Kernel, observations and detail, Eqs. (5), (7) and (18) to (20).
NORMAL_WEIGHT = 2.8  # beta, in desired spacings: distance of normals at a right angle. Ablation: "normals off".
NUGGET = 1e-4  # sigma_y^2 without noise, in units of the prior variance: keeps covariances regular.
DETAIL_DISTANCE = 2.8  # In desired spacings: distance of values of an attribute that are its whole range apart.
DETAIL_ROUGHNESS = 0.7  # Surface variation that counts as rough as a variance of the attributes of 1.
# Weights of an attribute's errors in Eq. (20), where that at the place has 1: interpolated in the fan, and by the
# nearest kept point. With the first alone, points lie so near to borders that the nearest one is often across.
DETAIL_INTERPOLATED, DETAIL_NEAREST = 0.2, 0.3
DETAIL_TRIALS, DETAIL_TRIED_ON = 20, 10  # Points of a cell that are tried, and that judge them, with attributes.

# Thin parts (research/experiments.md, "thin parts").
SHEET_SPACINGS = 2.0  # Of the cloud: distance of two sheets at least, as nearer ones mix in the plane of a point.
SHEET_GAP = 0.25  # Between two sheets lie at most so many points for each on the other one.
# Of a sample, the points beside another sheet whose own has a surface variation below the second; with fewer, a cloud
# has no thin parts. Scenes have 0.2 to 3 %, a desk scanned in frames 7 to 13 %, fan, turbine and plates 7 to 73 %.
THIN_FRACTION, SHEET_VARIATION = 0.05, 0.02
MUCH_THIN = 0.25  # Fraction of thin candidates from which on the roundness of their own sheets is a full factor.

# Survey and candidates, steps 1 and 2.
SAMPLE_SIZE = 100_000  # A larger cloud is sampled, as a tree over many millions takes longer than the choice.
SAMPLED_PER_POINT = 26  # Sampled points for each point to keep: about as many as measuring the noise needs.
# Points of the first stage at most. With 64, prefixes of 64 points are 2.6 % worse, of 32 points 2.3 % better.
FIRST_STAGE = 128
MIN_CANDIDATES = 3  # For each point to keep. With fewer, all points stay candidates.
# Cells of the candidates' grid for each point to keep at least, and points for each from which on there are as many
# as wanted. Where more points are kept, candidates are nearly all points, and the placement makes up for fewer.
FEWEST_CELLS, WANTED_FROM = 3.5, 23
MAX_CELLS = 3  # Occupied cells for each that the area has room for. A plane has 1.5 on average, 1.7 at most.
ISOLATION = (0.45, 0.9, 1.8, 3.6)  # In target spacings: a candidate is isolated if no other lies within the first.
# Candidates isolated within a distance are outliers if more than this fraction of them is isolated within twice that
# distance, too: mostly 28 % at most in scans with sparse parts, 40 % or more of outliers (research/experiments.md).
OUTLIERS = 0.4

# Placement, Eqs. (10) and (20). Ablation: "placement off".
CELL_POINTS, NOISY_CELL_POINTS = 36, 16  # Mean points of a cell, without noise and with it; of more, a sample is drawn.
# Points of a cell at most that judge an exchange, and all exchanges together. With 24 in the place of 40,
# the error on scenes is 0.5 % larger.
TRIED_ON, CHECKED_ON = 16, 32
PLANE_POINTS = 12  # Mean number of points to which a tangent plane is fitted.
PULL = 0.01  # eta: weight of the squared distance from the middle of the cell, beside that from the planes.
MAX_STEP = 0.7  # In mean distances to the three nearest chosen points.
GAP_GROWTH = 1.05  # Largest growth of the covering radius.
TRIALS = 3  # Points of a cell that are tried.
