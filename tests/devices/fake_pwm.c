// SPDX-License-Identifier: GPL-2.0
/* A PWM chip without hardware, for the device tests: what it is told goes to the kernel's log. */
#include <linux/err.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/pwm.h>

#define CHANNELS 8

static struct platform_device *device;
static struct pwm_chip chip;

static int fake_pwm_apply(struct pwm_chip *c, struct pwm_device *pwm, const struct pwm_state *state)
{
	pr_info("fake_pwm: channel %u period %llu pulse %llu %s\n", pwm->hwpwm, state->period,
		state->duty_cycle, state->enabled ? "on" : "off");
	return 0;
}

static const struct pwm_ops fake_pwm_ops = { .apply = fake_pwm_apply, .owner = THIS_MODULE };

static int __init fake_pwm_init(void)
{
	int error;

	device = platform_device_register_simple("fake_pwm", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device))
		return PTR_ERR(device);
	chip.dev = &device->dev;
	chip.ops = &fake_pwm_ops;
	chip.npwm = CHANNELS;
	error = pwmchip_add(&chip);
	if (error)
		platform_device_unregister(device);
	return error;
}

static void __exit fake_pwm_exit(void)
{
	pwmchip_remove(&chip);
	platform_device_unregister(device);
}

module_init(fake_pwm_init);
module_exit(fake_pwm_exit);
MODULE_LICENSE("GPL");
MODULE_DESCRIPTION("PWM chip without hardware");
