"""What each effect of the catalogue is in plain words, by name: for the reference page and reports.

The usual sizes in numbers stand with the effect's coefficients; `size` here says what such a size
means, or how it depends on the unit.
"""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class EffectWords:
    """Four sentences on an effect.

    what : physically. brought_on_by : what has to happen for it to show. size : what its usual size
    means to a user. remedy : what to do about it.
    """

    what: str
    brought_on_by: str
    size: str
    remedy: str


WORDS: Mapping[str, EffectWords] = {
    # gyro against temperature
    "gyro_thermal_linear": EffectWords(
        what="The gyro's bias is proportional to its temperature, beyond what the table removes.",
        brought_on_by="Any change of temperature: a warm-up, a cold start, a hot apron.",
        size="Before the factory's compensation it is three to twenty times as large.",
        remedy="Recalibrate with `recal update`; record starts at two temperatures.",
    ),
    "gyro_thermal_quadratic": EffectWords(
        what="The gyro's bias bends with temperature: its slope differs between cold and hot.",
        brought_on_by="A wide span of temperature; a narrow one shows its slope only.",
        size="Over 40 degC from the reference, 0.00005 deg/h per degC^2 makes 0.08 deg/h.",
        remedy="Recalibrate with runs that span the temperatures of use.",
    ),
    "gyro_thermal_rate": EffectWords(
        what="The bias follows how fast the temperature changes; in a fibre coil, light that runs "
        "both ways meets a warming stretch at different times (Shupe).",
        brought_on_by="Ramps: the first half hour after power-on, or a climb into cold air.",
        size="A warm-up of 1 degC/min gives as many deg/h as the coefficient says.",
        remedy="Fit it from a ramp with `recal thermal fog`, and record a ramp up and one down.",
    ),
    "gyro_thermal_gradient": EffectWords(
        what="The bias follows a difference of temperature across the gyro, which bends the block "
        "or shifts the flow of gas in a ring laser.",
        brought_on_by="Uneven warming: power-on, a fan, sun on one side.",
        size="It needs the differential reading; without one it looks like a thermal rate.",
        remedy="Log the gradient sensor and fit it with `recal thermal rlg`.",
    ),
    "gyro_thermal_lag": EffectWords(
        what="The part that makes the bias is slower than the thermometer, so the table is entered "
        "with a temperature that the part does not have yet.",
        brought_on_by="Any ramp; on a plateau the lag is gone.",
        size="A short lag cannot be told from a thermal rate: both are slope times lag.",
        remedy="Record a fast and a slow ramp; then the two can be told apart.",
    ),
    "gyro_thermal_hysteresis": EffectWords(
        what="At one temperature the bias differs between warming and cooling, because parts that "
        "expanded do not return along the same way.",
        brought_on_by="A reversal: a cooling run, or a restart while still warm.",
        size="It is as large as the width of the loop between the two branches.",
        remedy="Record one cooling run; a table alone cannot hold it.",
    ),
    "gyro_warmup_transient": EffectWords(
        what="The bias settles after power-on while electronics and laser reach their state, "
        "whatever the temperature is.",
        brought_on_by="Each power-on, for a few times its time constant.",
        size="On a single cold start it is nearly the same curve as a linear slope.",
        remedy="Wait before aligning, or record a hot restart to tell it from temperature.",
    ),
    "gyro_mode_hop": EffectWords(
        what="The bias waves with temperature, because reflections in the light path interfere.",
        brought_on_by="A wide span of temperature; it comes again at the same temperatures.",
        size="Its period is a few degC, shorter than the spacing of many tables.",
        remedy="Use a table with nodes closer than a quarter of the period.",
    ),
    "gyro_supply_voltage": EffectWords(
        what="The bias depends on the supply voltage or on a controller's set point.",
        brought_on_by="Change from ground power to the aircraft's own, or a weak battery.",
        size="All three axes move together, at the instant of the change.",
        remedy="Log the voltage; keep one power source through alignment.",
    ),
    # gyro constants, events and drifts
    "gyro_turn_on_bias": EffectWords(
        what="Each power-on gives the gyro another constant bias.",
        brought_on_by="Every power-on; within one session it does not change.",
        size="On the east gyro 0.01 deg/h turns the aligned heading by 0.94 mrad at 45 degrees.",
        remedy="Raise the twin's `turn_on_deg_h` if it is usual; no table can remove it.",
    ),
    "gyro_rate_ramp": EffectWords(
        what="The bias grows steadily with time, as a laser or a seal ages within a session.",
        brought_on_by="Time alone; two hours or several runs are needed to see it.",
        size="Over one hour it is as large as a turn-on bias.",
        remedy="Record a hot restart or a longer run to tell it from the end of a warm-up.",
    ),
    "gyro_bias_step": EffectWords(
        what="The bias jumps once, as when a controller resets or a mode changes.",
        brought_on_by="A single event at a time of its own.",
        size="A step of 0.01 deg/h shows within minutes in a parked log.",
        remedy="Split the session there; if it comes again at a temperature, inspect the unit.",
    ),
    "gyro_common_mode": EffectWords(
        what="All three gyros err together, from a shared clock, reference or supply.",
        brought_on_by="An event in what the gyros share; a true rotation looks the same.",
        size="Only its equality on three axes tells it from three drifts.",
        remedy="Look for the shared part: clock, reference voltage, heater.",
    ),
    # gyro against motion, force and field
    "gyro_scale_factor": EffectWords(
        what="The gyro reads a fixed share too much or too little of each rotation.",
        brought_on_by="Turns; parked, Earth rate makes almost nothing of it.",
        size="A turn of 90 degrees with 10 ppm is off by 3 arcsec.",
        remedy="Calibrate on a turntable, or from taxi turns against GNSS heading.",
    ),
    "gyro_scale_asymmetry": EffectWords(
        what="The gyro reads a left turn otherwise than an equal right turn.",
        brought_on_by="Turns to both sides; to one side it looks like a scale factor.",
        size="It adds up over a flight with more turns to one side than to the other.",
        remedy="Record turns to both sides; calibrate each direction.",
    ),
    "gyro_scale_thermal": EffectWords(
        what="The scale factor changes with temperature.",
        brought_on_by="Turns at two temperatures at least.",
        size="Over 40 degC it is as large as a scale factor of 20 to 200 ppm.",
        remedy="Calibrate the scale factor hot and cold.",
    ),
    "gyro_misalignment": EffectWords(
        what="The sensitive axis leans to another axis, so the gyro reads a share of that rate.",
        brought_on_by="Turns; parked, each heading gives another share of Earth rate.",
        size="Parked, 0.1 mrad of the horizontal Earth rate is 0.001 deg/h.",
        remedy="Measure it from four headings with `recal misalignment`.",
    ),
    "gyro_g_sensitivity": EffectWords(
        what="Acceleration shifts the gyro's bias, by mass imbalance or bending of the suspension.",
        brought_on_by="Load factor in flight, tilting; parked and level it is a constant.",
        size="Parked it hides in the turn-on bias; in a 2 g turn it doubles.",
        remedy="Calibrate by tumbling; keep load factors low where it matters.",
    ),
    "gyro_g2_sensitivity": EffectWords(
        what="Bias that grows with the square of acceleration; vibration is rectified by it.",
        brought_on_by="Engines, propellers, rough air.",
        size="Vibration of 1 g RMS gives what the coefficient says, with a mean of zero force.",
        remedy="Compare engine on and off; mount the unit on isolators.",
    ),
    "gyro_magnetic_sensitivity": EffectWords(
        what="A magnetic field shifts the bias: light of a fibre coil turns its polarisation, the "
        "gas of a ring laser drifts.",
        brought_on_by="Change of heading in Earth's field, tow trucks, power carts.",
        size="Earth's horizontal field is about 0.2 gauss at middle latitudes.",
        remedy="Record four headings or more; keep vehicles and cables away while aligning.",
    ),
    "gyro_lock_in": EffectWords(
        what="The two beams of a ring laser couple at low rates, so that small rates are lost; "
        "dither removes most of it.",
        brought_on_by="Slow rotation through zero rate, a dither that is too small.",
        size="The share that is left of a slow rate is what the coefficient says.",
        remedy="Check the dither's amplitude and its random part; a shop matter.",
    ),
    "gyro_dither_coning": EffectWords(
        what="Dithers of two axes couple through the block and make a coning motion, whose mean "
        "is a drift.",
        brought_on_by="Dither frequencies that lie close to one another.",
        size="Lines at the beats of the dithers go with it.",
        remedy="Log at 500 Hz or more to see the lines; move the dither frequencies apart.",
    ),
    "coning_residual": EffectWords(
        what="Rotation about an axis that itself moves is summed with an error by the algorithm.",
        brought_on_by="Angular vibration about two axes in flight, near the sampling rate.",
        size="1 deg/s about two axes at 50 Hz is a cone of 0.2 deg/h, of which a part is left.",
        remedy="Sample faster, or use increments with a coning correction.",
    ),
    # noise
    "gyro_angle_random_walk": EffectWords(
        what="White noise of the rate, more or less than the twin declares.",
        brought_on_by="Nothing; it is there at all times.",
        size="It limits alignment: sigma of heading falls with the root of time.",
        remedy="Correct `arw_deg_sqrt_h` in the twin.",
    ),
    "gyro_quantization": EffectWords(
        what="The angle is read in steps, as pulses of a ring laser are counted.",
        brought_on_by="Nothing; it shows at sampling rates of 1 Hz and more.",
        size="It does not grow: the accumulated angle stays within one step.",
        remedy="Give the twin the unit's step, `quantization_rad`.",
    ),
    "gyro_noise_thermal": EffectWords(
        what="The gyro is noisier while its temperature changes, or when hot.",
        brought_on_by="Warm-up and other ramps.",
        size="Ten to fifty percent of the noise on a plateau.",
        remedy="Align on a plateau, or give early minutes less weight.",
    ),
    "gyro_noise_of_time": EffectWords(
        what="The gyro's noise changes smoothly through the run, tied to nothing logged. It is a "
        "description, not a cause.",
        brought_on_by="Unknown; a temperature that was not logged, or vibration nearby.",
        size="Ten to fifty percent of the noise of the quieter part.",
        remedy="Record a second start: noise of a temperature comes again with it.",
    ),
    "slow_variation": EffectWords(
        what="A slow drift tied to nothing logged: flicker, random walk or a process with a "
        "correlation time. It is a description, not a cause.",
        brought_on_by="Unknown; temperature that was not logged is the first suspect.",
        size="Flicker of a navigation-grade gyro is a few 0.001 deg/h.",
        remedy="Correct the twin's noise, or log more: temperatures, voltages, events.",
    ),
    "compensation_misapplied": EffectWords(
        what="The thermal table was subtracted twice, not at all, or with the wrong sign.",
        brought_on_by="A log that says wrongly whether its gyros are compensated.",
        size="It is the table itself, times 1, -1 or -2.",
        remedy="Check `applied_table_sha256` of the run and the settings of the unit.",
    ),
    # accelerometers
    "accel_thermal": EffectWords(
        what="The accelerometer's bias follows its temperature.",
        brought_on_by="Warm-up; a real tilt differs in that the gyros feel it.",
        size="4.85 ug tilt the level by one arcsecond; raw it is five to ten times as large.",
        remedy="Recalibrate the accelerometer over temperature.",
    ),
    "accel_warmup_transient": EffectWords(
        what="The bias settles after power-on, as shell and inside of the sensor reach one "
        "temperature.",
        brought_on_by="Each power-on.",
        size="50 ug tilt the level by ten arcseconds.",
        remedy="Wait before aligning; a hot restart tells it from temperature.",
    ),
    "accel_thermal_hysteresis": EffectWords(
        what="At one temperature the bias differs between warming and cooling.",
        brought_on_by="A cooling run.",
        size="It is as large as the width of the loop.",
        remedy="Record a cooling run; use the mean of both branches in the table.",
    ),
    "accel_scale_factor": EffectWords(
        what="The accelerometer reads a fixed share too much or too little.",
        brought_on_by="Force: parked on the vertical axis, else when the vehicle accelerates.",
        size="100 ppm on the vertical axis are 100 ug.",
        remedy="Calibrate by tumbling; parked it cannot be told from the bias.",
    ),
    "accel_g2_sensitivity": EffectWords(
        what="Bias that grows with the square of force; vibration is rectified by it.",
        brought_on_by="Engines and rough air.",
        size="Vibration of 1 g RMS gives what the coefficient says.",
        remedy="Compare engine on and off; use isolators.",
    ),
    "accel_misalignment": EffectWords(
        what="The sensitive axis leans to another axis.",
        brought_on_by="Accelerations along the other axis.",
        size="Parked, 0.1 mrad of gravity are 100 ug, the same as a tilted installation.",
        remedy="Calibrate by tumbling, or align against the aircraft's own level.",
    ),
    "imu_size_effect": EffectWords(
        what="The three accelerometers sit some centimetres apart and feel different forces.",
        brought_on_by="Turns and angular acceleration.",
        size="5 cm at 0.1 rad/s are 50 ug.",
        remedy="Take the positions from the maker's drawing; correct forces when converting.",
    ),
    "accel_noise": EffectWords(
        what="White noise of the accelerometer, more or less than the twin declares.",
        brought_on_by="Nothing; sway of the vehicle looks alike.",
        size="It limits the level reached in the first seconds.",
        remedy="Correct `vrw_ug_sqrt_hz` in the twin.",
    ),
    "sculling_residual": EffectWords(
        what="Rotation and acceleration that vibrate in step leave a mean force.",
        brought_on_by="Vibration with a line that gyros and accelerometers share.",
        size="It grows with the product of the two amplitudes.",
        remedy="Sample faster, or use increments with a sculling correction.",
    ),
    # the vehicle while parked
    "platform_sway": EffectWords(
        what="Wind moves and rocks the parked vehicle on its tyres and struts.",
        brought_on_by="Gusts, people on board, jets that pass.",
        size="10 mm/s or 100 arcsec are a windy apron.",
        remedy="Raise the twin's `sway_m_s`, or align longer or in the lee.",
    ),
    "platform_settling": EffectWords(
        what="Struts, tyres or soft ground yield slowly, so that the vehicle turns a little.",
        brought_on_by="After taxi, after loading, on warm tarmac.",
        size="100 arcsec in 20 minutes are 0.08 deg/h, ten times a good gyro's drift.",
        remedy="Wait some minutes after stopping or loading.",
    ),
    "platform_step": EffectWords(
        what="The vehicle turns once within a second.",
        brought_on_by="Boarding, fuel, cargo, a door.",
        size="A person stepping in makes tens of arcseconds.",
        remedy="Keep off the vehicle while it aligns; such seconds are left out by `recal update`.",
    ),
    "platform_yaw_creep": EffectWords(
        what="The parked heading creeps as tyres and a tow bar unwind.",
        brought_on_by="A tight turn just before parking, a tow bar under load.",
        size="No accelerometer feels it: it cannot be told from the vertical gyro's drift.",
        remedy="Roll straight for some metres before parking; survey the heading.",
    ),
    "platform_mount_sag": EffectWords(
        what="The mount of the unit bends with temperature.",
        brought_on_by="Warm-up of the tray and its shock mounts.",
        size="1 arcsec per degC over 30 degC is half a minute of arc.",
        remedy="Log the block's temperature; use a stiffer mount.",
    ),
    "engine_start": EffectWords(
        what="Vibration of an engine raises the noise and shifts the accelerometers.",
        brought_on_by="Start of an engine or of the auxiliary power unit.",
        size="Noise and bias step at the same instant.",
        remedy="Align before the start, or cut the session there.",
    ),
    "site_latitude_error": EffectWords(
        what="The latitude that was entered is not the true one.",
        brought_on_by="Wrong entry, or the position of another stand.",
        size="One minute of arc is 0.003 deg/h of north rate, and 1.85 km.",
        remedy="Correct the site in `run.json`; compare with the first GNSS fix.",
    ),
    "vertical_deflection": EffectWords(
        what="Gravity is not along the normal of the ellipsoid, or not as strong as its formula.",
        brought_on_by="Mountains, dense rock; it belongs to the site.",
        size="10 arcsec tilt the level by 48 ug.",
        remedy="Take the deflection of a geoid model, or record at another site.",
    ),
    # wheels and GNSS
    "odometer_scale": EffectWords(
        what="The wheel's radius is not as entered, so speed is off by a fixed share.",
        brought_on_by="Tyre pressure, load, wear.",
        size="0.5 % of a kilometre are 5 m.",
        remedy="Correct `scale_ppm` in the twin.",
    ),
    "odometer_boresight": EffectWords(
        what="The vehicle's direction of rolling is not body x of the unit.",
        brought_on_by="A unit mounted with a yaw angle; a vehicle that crabs.",
        size="1 mrad is 1 mm/s aside at 1 m/s, and looks like a heading error.",
        remedy="Correct `crab_mrad` in the twin from straight legs both ways.",
    ),
    "odometer_time_offset": EffectWords(
        what="The wheel's time stamps are early or late.",
        brought_on_by="Accelerating and braking.",
        size="100 ms at 1 m/s^2 are 0.1 m/s.",
        remedy="Shift the odometer's times, or take its stamps at the source.",
    ),
    "odometer_quantization": EffectWords(
        what="Speed is counted in pulses and read in steps.",
        brought_on_by="Slow rolling; below one pulse a sample the wheel seems to stand.",
        size="One step is a pulse's way over the sampling interval.",
        remedy="Log pulses with their times, or average over a second.",
    ),
    "wheel_slip": EffectWords(
        what="The wheel turns slower than the vehicle moves while braking, faster under drive.",
        brought_on_by="Braking, thrust through the wheels, wet ground.",
        size="It is proportional to the acceleration.",
        remedy="Use a wheel that is neither driven nor braked.",
    ),
    "lever_arm": EffectWords(
        what="The unit is not where the run says, so turns carry it aside or along.",
        brought_on_by="Turns, to the left and to the right.",
        size="1 m at 0.1 rad/s is 0.1 m/s.",
        remedy="Measure the lever arms anew and correct `run.json`.",
    ),
    "side_slip": EffectWords(
        what="In a turn the tyres slip aside, in proportion to the lateral force.",
        brought_on_by="Turns at several speeds; at one speed it looks like a lever arm.",
        size="At 1 m/s^2 and 10 m/s, 10 mrad are 0.1 m/s aside.",
        remedy="Widen `lateral_noise_m_s` in the twin, or turn slower.",
    ),
    "false_standstill": EffectWords(
        what="The vehicle creeps where it is taken to stand.",
        brought_on_by="Stops with a foot off the brake, tugs, slopes.",
        size="1 cm/s through a stop of a minute are 0.6 m.",
        remedy="Brake at stops; do not mark creeping as parked.",
    ),
    "gnss_lever_arm_or_latency": EffectWords(
        what="The antenna is not where the run says, or fixes are late.",
        brought_on_by="Turns for the arm, speed for the latency.",
        size="100 ms at 10 m/s are 1 m along the way.",
        remedy="Measure the antenna's arm; take the receiver's pulse for time.",
    ),
    # navigation and data
    "schuler_start_error": EffectWords(
        what="An error of level or velocity at the start swings with the Schuler period of 84 min.",
        brought_on_by="Free-inertial navigation of 42 minutes and more.",
        size="10 arcsec of tilt swing the velocity by 0.38 m/s.",
        remedy="Align longer; level on a vehicle that does not settle.",
    ),
    "airframe_flexure": EffectWords(
        what="The airframe bends between unit and antenna.",
        brought_on_by="Load factor, fuel that is used up.",
        size="1 mrad over 5 m moves the antenna by 5 mm.",
        remedy="Mount unit and antenna on one frame.",
    ),
    "baro_lag": EffectWords(
        what="The barometric height is late, or off by a share of the climb.",
        brought_on_by="Climbs and descents.",
        size="2 % of a climb of 1,000 m are 20 m.",
        remedy="Calibrate the static pressure system; use GNSS height.",
    ),
    "timestamp_jitter": EffectWords(
        what="Samples are stamped unevenly, doubled or lost.",
        brought_on_by="A busy logger; it shows while rates change.",
        size="1 ms at 1 rad/s are 1 mrad in one sample, given back in the next.",
        remedy="Stamp at the sensor; convert with the unit's own counter.",
    ),
    "clock_rate": EffectWords(
        what="The unit's clock runs fast or slow, so that all rates are off by one share.",
        brought_on_by="Turns and long navigation; an oscillator without temperature control.",
        size="50 ppm of Earth rate are 0.00075 deg/h.",
        remedy="Discipline the clock by GNSS time.",
    ),
    "gyro_accel_skew": EffectWords(
        what="Gyros and accelerometers are sampled at different instants.",
        brought_on_by="Manoeuvres in which attitude and force change together.",
        size="5 ms at 0.1 rad/s put 0.5 mrad of the force on the wrong axis.",
        remedy="Shift one stream by the difference when converting.",
    ),
    "temperature_sensor_error": EffectWords(
        what="The thermometer that enters the table is late, off, or coarse.",
        brought_on_by="Ramps for the lag; the offset is always there.",
        size="It makes a bias of the table's slope times the error in degC.",
        remedy="Check the thermometer against another at rest; log finer steps.",
    ),
    "axis_or_unit_error": EffectWords(
        what="Axes are swapped, a sign is wrong, or a unit is not the one said.",
        brought_on_by="Conversion of a log, or a unit that was mounted otherwise.",
        size="Gross: Earth rate or gravity shows on the wrong axis.",
        remedy="Correct the column map, or run `recal check`.",
    ),
    "saturation_or_rounding": EffectWords(
        what="Values are clipped at the end of the range, or rounded to coarse steps.",
        brought_on_by="Shocks, high rates; a logger that stores few digits.",
        size="A clipped angle is lost for good; rounding makes stairs.",
        remedy="Choose the wider range; store 64-bit numbers.",
    ),
    # flight
    "gyro_saturation": EffectWords(
        what="The gyro is turned faster than it can read: its rows stand at the end of its range.",
        brought_on_by="Quick turns, hard landings, strong angular vibration.",
        size="The angle that is lost is gone for good: 0.01 deg/s over 10 s is 1.7 mrad.",
        remedy="Use a range that holds the manoeuvre, or a mount that swings less.",
    ),
    "accel_saturation": EffectWords(
        what="The accelerometer is driven past its range: its rows stand at the end of it.",
        brought_on_by="Hard landings, gusts, strong vibration.",
        size="The speed that is lost is gone for good: 0.01 g over 1 s is 0.1 m/s.",
        remedy="Use a range that holds the manoeuvre, or a softer mount.",
    ),
    "accel_vibration_rectification": EffectWords(
        what="A second-order term of the accelerometer turns vibration into a bias.",
        brought_on_by="Engines and turbulence: it changes with thrust and speed.",
        size="A vibration of 0.1 g makes 1 ug of 100 ug per g^2.",
        remedy="Mount the unit softer, or fit the coefficient from flights at two powers.",
    ),
    "gyro_vibration_rectification": EffectWords(
        what="Vibration of the mount makes a steady rate of the gyro.",
        brought_on_by="Engines and turbulence, beyond what the parked rows show.",
        size="A vibration of 0.1 g makes 0.001 deg/h of 0.1 deg/h per g^2.",
        remedy="Mount the unit softer, and log rows at 200 Hz or more.",
    ),
    "gyro_pressure_sensitivity": EffectWords(
        what="The gyro's bias follows the static pressure: its housing bends or its gas thins.",
        brought_on_by="Climbs and descents.",
        size="A climb to 3000 m is 310 hPa, 0.03 deg/h of 0.0001 deg/h per hPa.",
        remedy="Seal the housing, or fit the coefficient from a climb and a descent.",
    ),
    "accel_pressure_sensitivity": EffectWords(
        what="The accelerometer's bias follows the static pressure.",
        brought_on_by="Climbs and descents.",
        size="A climb to 3000 m makes 31 ug of 0.1 ug per hPa.",
        remedy="Seal the housing, or fit the coefficient from a climb and a descent.",
    ),
    "accel_scale_asymmetry": EffectWords(
        what="The accelerometer's scale differs between the two senses of its axis.",
        brought_on_by="Thrust and braking, or turns to both sides.",
        size="At 0.2 g, 50 ppm make 10 ug.",
        remedy="Measure it in a chamber with the axis up and down.",
    ),
    "gnss_clock_drift": EffectWords(
        what="The stamps of the fixes run away from the clock of the unit.",
        brought_on_by="Logging with two clocks that nothing disciplines; it shows at speed.",
        size="At 100 m/s, 10 ppm make 3.6 m after an hour.",
        remedy="Stamp both streams with one clock, or feed the receiver's pulse to the logger.",
    ),
    "gnss_slow_error": EffectWords(
        what="The fixes wander by metres over minutes: the ionosphere, reflections, orbits.",
        brought_on_by="Any receiver with one frequency; more near buildings and low satellites.",
        size="Some 0.3 to 5 m with periods of 3 to 50 min.",
        remedy="Use a receiver with two frequencies, or declare a larger sigma of its fixes.",
    ),
    "vertical_deflection_gradient": EffectWords(
        what="The plumb line leans more the farther the vehicle is from where it was aligned.",
        brought_on_by="Long legs over mountains or along a coast.",
        size="An arcsec of lean is 4.85 ug on a level accelerometer.",
        remedy="Take the deflection from a geoid model along the way.",
    ),
}

FREE_WORDS: Mapping[str, EffectWords] = {
    "unknown_function_of_temperature": EffectWords(
        what="Something that goes with temperature, as no named effect does.",
        brought_on_by="Changes of temperature.",
        size="Its curve over temperature is in the report.",
        remedy="Recalibrate; the twin can carry the curve as it is.",
    ),
    "unknown_function_of_temperature_rate": EffectWords(
        what="Something that goes with the rate of temperature, as no named effect does.",
        brought_on_by="Ramps.",
        size="Its curve over the rate is in the report.",
        remedy="Record ramps of two steepnesses, up and down.",
    ),
    "unknown_function_of_time": EffectWords(
        what="Something that goes with time since power-on, as no named effect does.",
        brought_on_by="Each power-on alike.",
        size="Its curve over time is in the report.",
        remedy="Record a hot restart, and log what else changes after power-on.",
    ),
    "unknown_function_of_run": EffectWords(
        what="A constant of its own in each run.",
        brought_on_by="Whatever differs between the runs.",
        size="Its value in each run is in the report.",
        remedy="Record more headings and sites, so that headings, site and power-on part.",
    ),
    "unknown_while_moving": EffectWords(
        what="An error of the sensor that is there only while the vehicle moves.",
        brought_on_by="Motion: vibration, engines, loads, or what runs only then.",
        size="The parked part of the run is free of it.",
        remedy="Log what differs on the move, and record drives at two speeds with stops.",
    ),
    "unknown": EffectWords(
        what="Something that goes with the vehicle's motion, as no named effect does.",
        brought_on_by="Speed, acceleration or turns.",
        size="It shows on odometer, side slip or GNSS.",
        remedy="Record turns to both sides at two speeds.",
    ),
}


TABLE_WORDS: Mapping[str, EffectWords] = {
    "table_aged": EffectWords(
        what="The gyro's bias has left its table, as far as the table's own sigma lets it.",
        brought_on_by="Time since the table was made; it is the same in every session.",
        size="A ring laser drifts by about 0.007 deg/h in a year; the table's sigma says it.",
        remedy="Renew the table: `recal update` with these runs.",
    )
}


def words_of(name: str) -> EffectWords | None:
    """The words on an effect, a free function or an aged table; None for an effect of a user's
    own.
    """
    return WORDS.get(name) or FREE_WORDS.get(name) or TABLE_WORDS.get(name)
