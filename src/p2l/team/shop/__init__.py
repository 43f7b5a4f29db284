"""A shop: the team planner's problem as people have it, with copies, robots, limits and a partial order.

Read `record`, then `outcome` (what a plan costs), then `planner`; `reading` makes one of a person's tables.
"""

from p2l.team.shop.certificate import check_shop_plan, shop_bound
from p2l.team.shop.outcome import ShopOutcome, shop_outcome
from p2l.team.shop.planner import plan_shop
from p2l.team.shop.reading import ShopReading, read_shop
from p2l.team.shop.record import Ruling, Shop, ShopCertificate, ShopPlan

__all__ = [
    "Ruling",
    "Shop",
    "ShopCertificate",
    "ShopOutcome",
    "ShopPlan",
    "ShopReading",
    "check_shop_plan",
    "plan_shop",
    "read_shop",
    "shop_bound",
    "shop_outcome",
]
