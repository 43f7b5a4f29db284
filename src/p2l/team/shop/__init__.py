"""A shop: the team planner's problem as people have it, with copies, robots, limits and a partial order.

Read `record`, then `outcome` (what a plan costs), then `planner`.
"""

from p2l.team.shop.certificate import check_shop_plan, shop_bound
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.record import Choice, Shop, ShopCertificate, ShopPlan

__all__ = [
    "Choice",
    "Shop",
    "ShopCertificate",
    "ShopOutcome",
    "ShopPlan",
    "check_shop_plan",
    "plan_shop",
    "shop_bound",
    "shop_outcome",
]
