"""Frames and rotations in plain floats.

Frames are those of docs/frames.md: camera (x right, y down, z forward), gimbal (x along the lens,
y right, z down), body (FRD), level (body without roll and pitch), local (NED), pad (x north,
y east, z down). ``R_a_b`` rotates a vector from frame b to frame a.

Only `math` and plain arithmetic: the core must give the same bits on every machine, and BLAS and
SIMD libraries do not. Vectors are 3-tuples, matrices row-major 3-tuples of 3-tuples.
"""

import math
from collections.abc import Sequence

Vec3 = tuple[float, float, float]
Mat3 = tuple[Vec3, Vec3, Vec3]

ZERO: Vec3 = (0.0, 0.0, 0.0)
IDENTITY: Mat3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

# A camera looks along its z, a gimbal along its x.
R_GIMBAL_CAMERA: Mat3 = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))

LEAST_COS_PITCH = 0.1  # steeper airframes are not flown


def wrap(angle: float) -> float:
    """Return the angle in (-pi, pi], rad."""
    if -math.pi < angle <= math.pi:
        return angle
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


def clamp(value: float, low: float, high: float) -> float:
    """Return the value limited to [low, high]."""
    return low if value < low else high if value > high else value


def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, k: float) -> Vec3:
    """Return k a."""
    return (k * a[0], k * a[1], k * a[2])


def towards(a: Vec3, b: Vec3, share: float) -> Vec3:
    """Return a + share (b - a)."""
    x, y, z = a
    return (x + share * (b[0] - x), y + share * (b[1] - y), z + share * (b[2] - z))


def dot(a: Vec3, b: Vec3) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return the vector product a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def norm(a: Vec3) -> float:
    """Return the length."""
    x, y, z = a
    return math.sqrt(x * x + y * y + z * z)


def unit(a: Vec3) -> Vec3:
    """Return a scaled to length 1.

    Raises:
        ZeroDivisionError: a is the zero vector.
    """
    x, y, z = a
    k = 1.0 / math.sqrt(x * x + y * y + z * z)
    return (k * x, k * y, k * z)


def angle_between(a: Vec3, b: Vec3) -> float:
    """Return the angle between two unit vectors, rad."""
    return math.acos(clamp(dot(a, b), -1.0, 1.0))


def is_finite(a: Vec3) -> bool:
    """Tell whether no component is NaN or infinite."""
    return math.isfinite(a[0]) and math.isfinite(a[1]) and math.isfinite(a[2])


def rotate(m: Mat3, v: Vec3) -> Vec3:
    """Return m v."""
    (a, b, c), (d, e, f), (g, h, i) = m
    x, y, z = v
    return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z)


def turned(v: Vec3, angle: float) -> Vec3:
    """Return v turned by an angle (rad) about z."""
    x, y, z = v
    c, s = math.cos(angle), math.sin(angle)
    return (c * x - s * y, s * x + c * y, z)


def transpose(m: Mat3) -> Mat3:
    """Return the transpose, for a rotation its inverse."""
    (a, b, c), (d, e, f), (g, h, i) = m
    return ((a, d, g), (b, e, h), (c, f, i))


def diagonal(a: float, b: float, c: float) -> Mat3:
    """Return the matrix with these on its diagonal and zeros beside it."""
    return ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))


def matmul(a: Mat3, b: Mat3) -> Mat3:
    """Return a b."""
    # Written out, as others here: they run thousands of times a second, and calls cost more than
    # the arithmetic.
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, z), (u, v, w), (p, q, r) = a
    return (
        (x * b00 + y * b10 + z * b20, x * b01 + y * b11 + z * b21, x * b02 + y * b12 + z * b22),
        (u * b00 + v * b10 + w * b20, u * b01 + v * b11 + w * b21, u * b02 + v * b12 + w * b22),
        (p * b00 + q * b10 + r * b20, p * b01 + q * b11 + r * b21, p * b02 + q * b12 + r * b22),
    )


def matmul_level(a: Mat3, b: Mat3) -> Mat3:
    """Return a b, where a mixes nothing into or out of z, as a rotation about z."""
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, _), (u, v, _), (_, _, r) = a
    return (
        (x * b00 + y * b10, x * b01 + y * b11, x * b02 + y * b12),
        (u * b00 + v * b10, u * b01 + v * b11, u * b02 + v * b12),
        (r * b20, r * b21, r * b22),
    )


def matmul_transposed(a: Mat3, b: Mat3) -> Mat3:
    """Return a b^T."""
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, z), (u, v, w), (p, q, r) = a
    return (
        (x * b00 + y * b01 + z * b02, x * b10 + y * b11 + z * b12, x * b20 + y * b21 + z * b22),
        (u * b00 + v * b01 + w * b02, u * b10 + v * b11 + w * b12, u * b20 + v * b21 + w * b22),
        (p * b00 + q * b01 + r * b02, p * b10 + q * b11 + r * b12, p * b20 + q * b21 + r * b22),
    )


def matadd(a: Mat3, b: Mat3) -> Mat3:
    """Return a + b."""
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, z), (u, v, w), (p, q, r) = a
    return (
        (x + b00, y + b01, z + b02),
        (u + b10, v + b11, w + b12),
        (p + b20, q + b21, r + b22),
    )


def add_transpose(m: Mat3) -> Mat3:
    """Return m + m^T."""
    (a, b, c), (d, e, f), (g, h, i) = m
    x, y, z = b + d, c + g, f + h
    return ((a + a, x, y), (x, e + e, z), (y, z, i + i))


def matadd_scaled(a: Mat3, b: Mat3, k: float) -> Mat3:
    """Return a + k b."""
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, z), (u, v, w), (p, q, r) = a
    return (
        (x + k * b00, y + k * b01, z + k * b02),
        (u + k * b10, v + k * b11, w + k * b12),
        (p + k * b20, q + k * b21, r + k * b22),
    )


def add_diagonal(m: Mat3, d: Vec3) -> Mat3:
    """Return m with d added to its diagonal."""
    (a, b, c), (e, f, g), (h, i, j) = m
    return ((a + d[0], b, c), (e, f + d[1], g), (h, i, j + d[2]))


def matsub(a: Mat3, b: Mat3) -> Mat3:
    """Return a - b."""
    (b00, b01, b02), (b10, b11, b12), (b20, b21, b22) = b
    (x, y, z), (u, v, w), (p, q, r) = a
    return (
        (x - b00, y - b01, z - b02),
        (u - b10, v - b11, w - b12),
        (p - b20, q - b21, r - b22),
    )


def sub_product(m: Mat3, a: Mat3, b: Mat3) -> Mat3:
    """Return m - a b^T."""
    (x, y, z), (u, v, w), (p, q, r) = a
    (c, d, e), (f, g, h), (i, j, k) = b
    (m00, m01, m02), (m10, m11, m12), (m20, m21, m22) = m
    return (
        (
            m00 - (x * c + y * d + z * e),
            m01 - (x * f + y * g + z * h),
            m02 - (x * i + y * j + z * k),
        ),
        (
            m10 - (u * c + v * d + w * e),
            m11 - (u * f + v * g + w * h),
            m12 - (u * i + v * j + w * k),
        ),
        (
            m20 - (p * c + q * d + r * e),
            m21 - (p * f + q * g + r * h),
            m22 - (p * i + q * j + r * k),
        ),
    )


def matscale(a: Mat3, k: float) -> Mat3:
    """Return k a."""
    (x, y, z), (u, v, w), (p, q, r) = a
    return ((k * x, k * y, k * z), (k * u, k * v, k * w), (k * p, k * q, k * r))


def outer(a: Vec3, b: Vec3) -> Mat3:
    """Return a b^T."""
    (x, y, z), (u, v, w) = a, b
    return ((x * u, x * v, x * w), (y * u, y * v, y * w), (z * u, z * v, z * w))


def axial(v: Vec3, k: float, c: float) -> Mat3:
    """Return k v v^T + c I, which is alike in all directions about v."""
    x, y, z = v
    xy, xz, yz = k * (x * y), k * (x * z), k * (y * z)
    return ((c + k * (x * x), xy, xz), (xy, c + k * (y * y), yz), (xz, yz, c + k * (z * z)))


def rotate_covariance(R: Mat3, covariance: Mat3) -> Mat3:
    """Return R covariance R^T: the covariance in the frame that R rotates to."""
    return matmul_transposed(matmul(R, covariance), R)


def inverse(m: Mat3) -> Mat3:
    """Return the inverse of a 3x3 matrix by cofactors.

    Raises:
        ZeroDivisionError: m is singular.
    """
    (a, b, c), (d, e, f), (g, h, i) = m
    x, y, z = e * i - f * h, f * g - d * i, d * h - e * g
    k = 1.0 / (a * x + b * y + c * z)
    return (
        (k * x, k * (h * c - i * b), k * (b * f - c * e)),
        (k * y, k * (i * a - g * c), k * (c * d - a * f)),
        (k * z, k * (g * b - h * a), k * (a * e - b * d)),
    )


def rot_y(angle: float) -> Mat3:
    """Return the rotation by angle (rad) about y."""
    c, s = math.cos(angle), math.sin(angle)
    return ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))


def rot_z(angle: float) -> Mat3:
    """Return the rotation by angle (rad) about z."""
    c, s = math.cos(angle), math.sin(angle)
    return ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))


def rot_zyx(yaw: float, pitch: float, roll: float) -> Mat3:
    """Return Rz(yaw) Ry(pitch) Rx(roll), angles in rad: body to local, or gimbal to body."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    return (
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def rot_zxy(yaw: float, roll: float, pitch: float) -> Mat3:
    """Return Rz(yaw) Rx(roll) Ry(pitch), angles in rad: gimbal to what its angles are against."""
    cy, sy = math.cos(yaw), math.sin(yaw)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cr, sr = math.cos(roll), math.sin(roll)
    return (
        (cy * cp - sy * sr * sp, -sy * cr, cy * sp + sy * sr * cp),
        (sy * cp + cy * sr * sp, cy * cr, sy * sp - cy * sr * cp),
        (-cr * sp, sr, cr * cp),
    )


def euler_rates(roll: float, pitch: float, rates: Sequence[float]) -> Vec3:
    """Return how fast roll, pitch and yaw (ZYX) change with body rates p, q, r, rad/s.

    Towards 90 degrees of pitch there are no such rates: there they are bounded.
    """
    p, q, r = rates
    yaw = (math.sin(roll) * q + math.cos(roll) * r) / max(math.cos(pitch), LEAST_COS_PITCH)
    return p + math.sin(pitch) * yaw, math.cos(roll) * q - math.sin(roll) * r, yaw


def rotation(q: Sequence[float]) -> Mat3 | None:
    """Return the rotation of a quaternion (w, x, y, z); None if it is none."""
    w, x, y, z = q
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0.9 < length < 1.1:
        return None
    w, x, y, z = w / length, x / length, y / length, z / length
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def angles_zxy(R: Mat3) -> Vec3:
    """Return yaw, pitch and roll (rad) of Rz(yaw) Rx(roll) Ry(pitch) = R, also straight down."""
    return (
        math.atan2(-R[0][1], R[1][1]),
        math.atan2(-R[2][0], R[2][2]),
        math.asin(clamp(R[2][1], -1.0, 1.0)),
    )


def rotation_vector(R: Mat3) -> Vec3:
    """Return the axis of a rotation times its angle, rad."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    angle = math.atan2(math.hypot(x, y, z), 0.5 * (xx + yy + zz - 1.0))
    size = math.sin(angle)
    return scale((x, y, z), 1.0 if size < 1e-9 else angle / size)


def camera_mount(rotation_deg: Vec3) -> Mat3:
    """Return R_gimbal_camera of a camera that sits turned by roll, pitch, yaw (degrees)."""
    roll, pitch, yaw = (math.radians(angle) for angle in rotation_deg)
    return matmul(rot_zyx(yaw, pitch, roll), R_GIMBAL_CAMERA)


def heading_of(v: Vec3) -> float:
    """Return the angle of v's horizontal part from x (north) towards y (east), rad."""
    return math.atan2(v[1], v[0])


def horizontal(v: Vec3) -> float:
    """Return the length of v's horizontal part (x, y)."""
    return math.hypot(v[0], v[1])


def horizontal_sigma(covariance: Mat3) -> float:
    """Return the standard deviation in the horizontal direction in which it is largest.

    That is the root of the larger eigenvalue of the (x, y) block: the same whichever way x points.
    """
    (xx, xy, _), (_, yy, _), _ = covariance
    return math.sqrt(max(0.0, 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)))


def largest_sigma(covariance: Mat3) -> float:
    """Return the larger of the horizontal and the vertical standard deviation."""
    return max(horizontal_sigma(covariance), math.sqrt(max(0.0, covariance[2][2])))
