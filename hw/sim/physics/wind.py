"""Wind: steady, with gusts, or as in the thesis (3.8)."""

import math
from random import Random

from hw.sim.options import WindOptions

UPDATE_S = 0.02  # wind is constant in between


class _Noise:
    """Gaussian noise with a correlation time (Ornstein-Uhlenbeck), standard deviation 1."""

    def __init__(self, correlation_s: float, rng: Random) -> None:
        self._decay = math.exp(-UPDATE_S / correlation_s)
        self._noise = math.sqrt(1.0 - self._decay * self._decay)
        self._rng = rng
        self._value = rng.gauss(0.0, 1.0)

    def next(self) -> float:
        self._value = self._decay * self._value + self._noise * self._rng.gauss(0.0, 1.0)
        return self._value


class SteadyWind:
    """A mean wind with gusts on top.

    A gust rises and falls as 1 - cos over `gust_s` and reaches `gust_mps` along a direction within
    30 degrees of the mean wind's, with it or against it; pauses of up to `gust_s` are in between.
    """

    def __init__(self, options: WindOptions, rng: Random) -> None:
        whence = rng.uniform(-180.0, 180.0) if options.from_deg is None else options.from_deg
        self._towards = math.radians(whence) + math.pi
        self._mean = options.speed_mps
        self._gust, self._duration = options.gust_mps, options.gust_s
        self._rng = rng
        self._begin = self._end = 0.0
        self._heading = self._sign = 0.0
        sigma = options.turbulence_mps
        self._turbulence = DrydenTurbulence(sigma, self._mean, rng) if sigma else None

    def at(self, t: float) -> tuple[float, float]:
        """Return the air's velocity north and east, m/s; called every UPDATE_S."""
        n = self._mean * math.cos(self._towards)
        e = self._mean * math.sin(self._towards)
        if self._gust:
            while t >= self._end:
                self._begin = self._end + self._rng.uniform(0.0, self._duration)
                self._end = self._begin + self._duration
                self._heading = self._towards + math.radians(self._rng.uniform(-30.0, 30.0))
                self._sign = self._rng.choice((-1.0, 1.0))
            if t > self._begin:
                phase = 2.0 * math.pi * (t - self._begin) / self._duration
                size = self._sign * self._gust * 0.5 * (1.0 - math.cos(phase))
                n += size * math.cos(self._heading)
                e += size * math.sin(self._heading)
        if self._turbulence is not None:
            along, across = self._turbulence.next()
            n += along * math.cos(self._towards) - across * math.sin(self._towards)
            e += along * math.sin(self._towards) + across * math.cos(self._towards)
        return n, e


class ThesisWind:
    """The wind of thesis 3.8.

    Base of 1 m/s to the north and 1 m/s to the west; speed: plus a sine of 1 m/s and 20 s and
    noise of mean 1 and standard deviation 0.5 m/s; direction: plus a sine of 1 rad and 10 s and
    noise of mean 1 and standard deviation 0.5 rad. The thesis does not give the noise's
    correlation time; 1 s here.
    """

    def __init__(self, rng: Random) -> None:
        self._speed_noise = _Noise(1.0, rng)
        self._direction_noise = _Noise(1.0, rng)

    def at(self, t: float) -> tuple[float, float]:
        """Return the air's velocity north and east, m/s; called every UPDATE_S."""
        speed = math.sqrt(2.0) + math.sin(2.0 * math.pi * t / 20.0)
        speed += 1.0 + 0.5 * self._speed_noise.next()
        heading = -0.25 * math.pi + math.sin(2.0 * math.pi * t / 10.0)
        heading += 1.0 + 0.5 * self._direction_noise.next()
        return speed * math.cos(heading), speed * math.sin(heading)


class DrydenTurbulence:
    """Turbulence of Dryden's spectra at low altitude (MIL-F-8785C), level components.

    Along the wind a first-order, across it a second-order filter of white noise. The scale length
    at a height h in feet is h / (0.177 + 0.000823 h)^1.2; the air passes at the mean wind's speed,
    at least 3 m/s for a vehicle that moves about in it.
    """

    HEIGHT_M = 8.0  # typical of an approach
    LEAST_AIRSPEED_MPS = 3.0

    def __init__(self, sigma_mps: float, mean_mps: float, rng: Random) -> None:
        feet = self.HEIGHT_M / 0.3048
        length_m = 0.3048 * feet / (0.177 + 0.000823 * feet) ** 1.2
        self.time_s = length_m / max(mean_mps, self.LEAST_AIRSPEED_MPS)
        self._sigma = sigma_mps
        self._along = _Noise(self.time_s, rng)
        self._across = _Noise(self.time_s, rng)
        self._smoothed = 0.0

    def next(self) -> tuple[float, float]:
        """Return the components along and across the wind, m/s; called every UPDATE_S."""
        # (1 + sqrt(3) T s) / (1 + T s)^2 = sqrt(3) / (1 + T s) + (1 - sqrt(3)) / (1 + T s)^2; with
        # the first term's noise of variance 1 the whole has 2.
        noise = self._across.next()
        self._smoothed += (noise - self._smoothed) * UPDATE_S / self.time_s
        across = math.sqrt(3.0) * noise + (1.0 - math.sqrt(3.0)) * self._smoothed
        return self._sigma * self._along.next(), self._sigma * across / math.sqrt(2.0)


Wind = SteadyWind | ThesisWind


def make_wind(options: WindOptions, rng: Random) -> Wind:
    """Return the wind that the options ask for."""
    return ThesisWind(rng) if options.model == "thesis" else SteadyWind(options, rng)
