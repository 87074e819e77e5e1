"""Page of ``runout what-if``."""


def page(site, results, sweep, members, outcomes, notes):
    return "<p>x</p>"
